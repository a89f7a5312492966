"""Measuring no more than a stated uncertainty takes: when a run has enough cycles."""
