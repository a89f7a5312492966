"""A run against the shadow: drift, leak, periodic interference, sequential alarms."""
