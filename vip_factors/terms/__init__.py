"""Terms of the objective, one residual per file: residuals, derivatives and equations of each kind of factor."""
