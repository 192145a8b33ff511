"""Programs that estimate: calibration, odometry, integrated navigation."""
