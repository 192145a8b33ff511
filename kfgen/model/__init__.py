"""Filter models: state blocks, motion, sensors and the effects of their channels."""
