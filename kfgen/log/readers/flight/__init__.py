"""Readers of autopilots' logs."""
