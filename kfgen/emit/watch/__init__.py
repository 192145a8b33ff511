"""Parts of the supervisor, each of which an emission may leave out: rest, bounds of biases, hooks for lanes."""
