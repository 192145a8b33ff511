"""The gap: where a believed model and a record disagree, what is missing, and the mended model."""
