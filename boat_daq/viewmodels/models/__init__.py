"""View models of the optics and trade-off pages."""
