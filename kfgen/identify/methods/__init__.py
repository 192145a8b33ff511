"""The methods of identification behind one interface."""
