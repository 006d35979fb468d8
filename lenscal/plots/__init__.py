"""Figures: every function takes an Axes and returns it; none shows anything."""
