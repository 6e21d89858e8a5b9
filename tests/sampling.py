"""Parameter sets of which the default test run takes a sample; the others are marked slow."""

from collections.abc import Collection, Iterable
from typing import Any

import pytest


def sampled(values: Iterable[Any], default: Collection[Any]) -> list[Any]:
    """Values as parameters of a test; those outside the default sample are marked slow."""
    return [value if value in default else _slow(value) for value in values]


def _slow(value):
    """Slow parameter of one value or several."""
    return pytest.param(*(value if isinstance(value, tuple) else (value,)), marks=pytest.mark.slow)
