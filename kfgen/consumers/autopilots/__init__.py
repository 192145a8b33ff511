"""Filters of autopilots."""
