"""What readers share: tables, streams, clocks, axes."""
