"""What happens to single samples: events, outliers, bursts, filters."""
