"""Filters, least squares, observability and covariance analysis: pure functions of arrays."""
