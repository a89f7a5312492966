"""Recordings and tables of numbers: read, imported, written, exported."""
