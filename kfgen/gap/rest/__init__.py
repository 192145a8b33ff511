"""The gap of a sensor at rest."""
