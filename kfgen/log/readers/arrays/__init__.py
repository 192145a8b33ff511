"""Readers of named arrays."""
