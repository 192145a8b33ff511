"""Calibration of a triad: of a magnetometer that was turned, an accelerometer in poses, a gyro turned by known angles."""
