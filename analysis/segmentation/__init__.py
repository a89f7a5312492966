"""Cycles, plateaus, loops and strokes in a recording, and what each window lost."""
