"""Time series: ARMA processes, what they stand for, how they are estimated, and tests of a series."""
