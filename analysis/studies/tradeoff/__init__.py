"""Time against error of every method, measured on this machine."""
