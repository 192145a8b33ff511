"""Identification: which effects a static record shows, how large, and what it cannot tell."""
