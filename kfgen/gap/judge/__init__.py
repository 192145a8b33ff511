"""A declaration of an effect on trial: what it explains of a log, and whether it is found where it is, and only there."""
