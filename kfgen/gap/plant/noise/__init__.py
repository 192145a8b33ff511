"""Process noise of a plant: innovations of a filter about a path, and the densities that a log asks for."""
