"""What every room stands on: units, errors, files, linear systems, expressions."""
