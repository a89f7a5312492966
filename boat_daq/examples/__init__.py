"""Scripts that measure: run one by itself, or copy from it."""
