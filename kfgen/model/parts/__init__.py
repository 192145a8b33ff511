"""Parts of a filter: motions and sensors."""
