"""Adaptive Kalman filters: one algorithm, a rule for each, and what they cost under motion."""
