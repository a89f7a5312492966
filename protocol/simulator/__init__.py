"""The virtual board: plant, sensors, ADC front end, channel and faults, seeded and without a clock."""
