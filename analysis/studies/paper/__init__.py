"""The numbers and drawings of the paper, computed again."""
