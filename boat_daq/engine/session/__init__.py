"""The session: everything between a window or a command and the board."""
