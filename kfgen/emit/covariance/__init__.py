"""Covariance arithmetic: packed storage and UD factors."""
