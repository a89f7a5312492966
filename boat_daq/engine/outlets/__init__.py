"""Outlets: what leaves the program while it runs, each a sink or a client of the session that delays neither."""
