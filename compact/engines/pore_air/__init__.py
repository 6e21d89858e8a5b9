"""Pore air under a roller: its steady flow, and the load and resistance that it adds to those of the skeleton."""
