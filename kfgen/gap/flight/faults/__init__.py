"""Faults of a flight log that a fit would be spoilt by."""
