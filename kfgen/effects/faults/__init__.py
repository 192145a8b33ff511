"""Faults of the rig and of the log: found by looking, no filter models them."""
