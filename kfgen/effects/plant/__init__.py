"""Effects inside the equations of a plant, on its inputs and its sensors."""
