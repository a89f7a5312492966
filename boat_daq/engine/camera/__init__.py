"""Cameras: their sources, and the thread that captures."""
