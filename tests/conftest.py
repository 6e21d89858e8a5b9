"""Hypothesis draws the same examples in every run, and slow machines do not fail a test."""

from hypothesis import settings

settings.register_profile("compact", deadline=None, derandomize=True, print_blob=True)
settings.load_profile("compact")
