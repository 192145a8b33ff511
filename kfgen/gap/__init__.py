"""The gap: where an assumed model and a record disagree, what is missing, and the updated model."""
