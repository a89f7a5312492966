"""Fault drills on this installation and their report."""
