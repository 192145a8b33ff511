"""Manoeuvres as data: what a body does, for the simulation in numbers and for the audit exactly."""
