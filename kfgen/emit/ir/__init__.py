"""Straight-line scalar code: from sympy, tidied, run as the reference."""
