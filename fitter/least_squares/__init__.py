"""Residuals, their weights and derivatives, solvers, and the covariance of a solution."""
