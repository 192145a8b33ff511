"""The gap of a plant, against its model file."""
