"""Hypothesis draws the same examples in every run, and slow machines do not fail a test; half the usual number."""

from hypothesis import settings

settings.register_profile("compact", max_examples=50, deadline=None, derandomize=True, print_blob=True)
settings.load_profile("compact")
