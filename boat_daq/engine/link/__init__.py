"""Ports: opened, read by one thread, watched."""
