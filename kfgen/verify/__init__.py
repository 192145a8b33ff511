"""Proof: the emitted filter is compiled, run on cores, and compared bit by bit."""
