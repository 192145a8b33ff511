"""A filter over a log."""
