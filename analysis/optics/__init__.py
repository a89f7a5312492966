"""The optical model: scenes, rays, the sweep over cavity patterns."""
