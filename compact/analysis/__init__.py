"""Analyses of a scene: contacts, resistance map, drives, comparison of engines, calibration, uncertainty."""
