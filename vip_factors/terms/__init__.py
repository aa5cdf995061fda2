"""Terms of the objective: residuals, derivatives and equations of each kind of factor."""
