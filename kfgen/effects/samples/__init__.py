"""Effects that act on samples and have no states in a filter: steps, outliers, bursts, shared noise."""
