"""What every layer shares: errors, array types, units of measurement, and files read and written safely."""
