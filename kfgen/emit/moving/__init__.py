"""Alignment in motion: the first attitude from two velocities, what the inertial sensors showed between them, and north."""
