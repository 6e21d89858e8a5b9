"""Cases of which the default test run takes a sample; the slow run (`pytest -m slow`) takes the others.

`pytest.mark.sampled(n)` leaves n cases of a parametrised test in the default run (`conftest`).
"""

from collections.abc import Callable, Collection, Iterable
from typing import Any

import pytest
from hypothesis import settings

GOLDEN_RATIO = (5**0.5 - 1) / 2  # [-], of an additive recurrence: its first terms spread evenly for any count

slow_run = False  # set by `conftest` before the tests are imported


def sampled(values: Iterable[Any], default: Collection[Any]) -> list[Any]:
    """Values as parameters of a test; those outside the default sample are marked slow."""
    return [value if value in default else _slow(value) for value in values]


def _slow(value):
    """Slow parameter of one value or several."""
    return pytest.param(*(value if isinstance(value, tuple) else (value,)), marks=pytest.mark.slow)


def sample(items: list[Any], count: int) -> list[Any]:
    """Sample of at most `count` items, spread evenly and the same in every run."""
    order = sorted(range(len(items)), key=lambda number: (number + 1) * GOLDEN_RATIO % 1)
    return [items[number] for number in order[:count]]


def examples(default: int, slow: int) -> Callable[[Any], Any]:
    """Number of hypothesis examples in the default run, and in the slow run, which repeats the test."""

    def decorate(test):
        return pytest.mark.repeated(settings(max_examples=slow if slow_run else default)(test))

    return decorate
