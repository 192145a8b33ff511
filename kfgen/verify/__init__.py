"""Proof: the emitted filter is compiled, run on cores, and compared word by word."""
