"""What is removed from a record, or said of it, before its noise is fitted."""
