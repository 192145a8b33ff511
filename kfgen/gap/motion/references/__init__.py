"""References of a motion: holes, rounding, axes and frames."""
