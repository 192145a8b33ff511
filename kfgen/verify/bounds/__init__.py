"""Bounds of emitted code: intervals over the intermediate form, what they assume, and hostile calls that test both."""
