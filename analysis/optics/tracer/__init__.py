"""Rays through a scene: Snell, Fresnel, secondary rays, counts and powers."""
