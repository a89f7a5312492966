"""Recordings on disk: written, closed, recovered, resumed, verified."""
