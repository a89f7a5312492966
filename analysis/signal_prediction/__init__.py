"""Signals predicted from pressure: shape, rays, detected light, voltage; and a run compared with them."""
