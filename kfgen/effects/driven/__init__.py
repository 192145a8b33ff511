"""What follows a recorded driver: a temperature, a supply, any other channel."""
