"""The gap of sensors that move, against references."""
