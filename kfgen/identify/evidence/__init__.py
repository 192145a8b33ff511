"""What is identified: records, curves and streams, and the likelihood of each."""
