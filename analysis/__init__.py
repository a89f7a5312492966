"""Offline analysis: arrays and files in, figures out. What a script imports."""
