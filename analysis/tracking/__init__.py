"""From pictures to elongation: arrays in, elongation out; no camera, no thread."""
