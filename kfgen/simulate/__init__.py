"""From a model to a log."""
