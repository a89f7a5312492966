"""The board link: bytes in, events out. No thread, no clock, no port, no window."""
