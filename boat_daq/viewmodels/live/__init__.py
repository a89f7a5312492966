"""View models of the live and shadow pages."""
