"""Weights of factors found by trying: Bayesian optimisation on recordings whose truth is known."""
