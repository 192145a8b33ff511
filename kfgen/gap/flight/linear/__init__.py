"""The filter of a flight about a path, linear in everything: its matrices, its passes, and what they show."""
