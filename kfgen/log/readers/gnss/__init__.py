"""Readers of GNSS receivers and their solutions."""
