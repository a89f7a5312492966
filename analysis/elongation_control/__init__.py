"""Elongation as a setpoint: the identified hysteresis, the controller, its tuning and its dynamics."""
