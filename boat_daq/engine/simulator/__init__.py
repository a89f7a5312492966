"""Serves the virtual board on a port of this computer."""
