"""The optics, shadow and trade-off pages."""
