"""Plots: axes, cards, labels, the shadow's pane."""
