"""Symbols of a filter: state blocks, rotations, error conventions."""
