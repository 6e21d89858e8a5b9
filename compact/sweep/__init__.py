"""Sweeps of scenes over parameters: design, points, checkpoints, Sobol indices."""
