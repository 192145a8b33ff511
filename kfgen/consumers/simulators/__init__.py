"""Programs that simulate sensors."""
