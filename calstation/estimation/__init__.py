"""Solvers: filters, least squares, observability and covariance analysis as pure functions of arrays."""
