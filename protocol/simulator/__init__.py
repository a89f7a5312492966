"""The virtual board: plant, sensors, converter, link and faults, seeded and without a clock."""
