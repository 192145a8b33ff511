"""Many logs of sensors of one kind: the population that they are drawn from, and which are not of it."""
