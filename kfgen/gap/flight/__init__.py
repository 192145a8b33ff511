"""The gap of a navigation filter over a log without a reference: its innovations are the evidence."""
