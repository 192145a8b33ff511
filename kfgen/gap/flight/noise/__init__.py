"""The sizes of a filter's noises by its innovations over a flight."""
