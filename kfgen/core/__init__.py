"""What every layer stands on: units, errors, files, linear systems, expressions."""
