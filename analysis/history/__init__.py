"""Several runs together: folders of runs, a unit over time, between-run spread, when to calibrate again."""
