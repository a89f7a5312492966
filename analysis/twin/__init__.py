"""Elongation as a setpoint: identified hysteresis, the controller, its tuning, and the predicted signal."""
