"""Data whose residuals are vectors in time: motion beside references, plants, flights; one search for all."""
