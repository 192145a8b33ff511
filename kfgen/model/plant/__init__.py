"""Plants from model files: read, simulated, made into filters."""
