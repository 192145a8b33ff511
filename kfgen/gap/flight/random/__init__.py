"""Random errors of channels in flight: states of the filter, their search, and whether their course is random."""
