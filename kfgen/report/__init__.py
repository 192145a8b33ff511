"""Answers: each result as text, as JSON, and as a page that needs nothing else."""
