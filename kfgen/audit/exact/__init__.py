"""The exact rank of an observability matrix: p-adic numbers and power series."""
