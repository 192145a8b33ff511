"""Errors of inertial and magnetic triads that motion shows."""
