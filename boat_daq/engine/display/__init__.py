"""The last hour in memory for the screen."""
