"""The published experiments again, on motions with known truth, and how fast and how large the solver is."""
