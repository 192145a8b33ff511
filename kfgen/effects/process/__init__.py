"""Random and deterministic processes of one channel at rest: each a linear system."""
