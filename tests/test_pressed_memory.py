"""What pressed mix remembers of a roller that turns: the closed form of columns, and what is fitted."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad

from compact.pressed_memory import PressedMemory, fitted, released

MEMORY = PressedMemory(turning=800.0, again=50.0, release=1e-3, recovery=15e-3)


@pytest.mark.parametrize("z", [0.0, 0.3, 1.0, 1.7, 10.0])
def test_release_is_that_of_columns_under_even_pressure(z):
    """p, M/(h R) and R of one, a = 1: F = int max(1 - z x, 0) x dx over int x dx."""
    left, _ = quad(lambda x: max(1 - z * x, 0.0) * x, 0, min(1.0, 1 / max(z, 1e-9)), epsrel=1e-12)
    assert released(z) == pytest.approx(2 * left, rel=1e-10)


def test_resistance_goes_from_that_of_the_turn_to_that_of_the_way_back():
    assert MEMORY.resistance(0.0) == pytest.approx(800.0)
    assert MEMORY.resistance(1.0) == pytest.approx(-50.0, abs=1e-3)
    assert MEMORY.resistance([[0.0], [1e-3]]).shape == (2, 1)


def made(again=50.0, fed=0.0):
    """Travelled as the memory says, there and back by 0.1 m."""
    back = np.concatenate([[2e-4, 5e-4], np.linspace(1e-3, 0.1, 100)])
    return SimpleNamespace(
        stroke=np.repeat([1, 2], [2, len(back)]),
        position=np.concatenate([[0.0, 0.1], 0.1 - back]),
        lowest=np.repeat([0.09, 0.09 + fed], [2, len(back)]),
        leading=np.full(2 + len(back), 0.02),
        trailing=np.full(2 + len(back), -0.002),
        resistance=np.concatenate([[0.0, 800.0], PressedMemory(800.0, again, 1e-3, 5e-3).resistance(back)]),
    )


def test_fit_finds_the_lengths_it_was_made_of():
    memory = fitted(made())
    assert (memory.release, memory.recovery) == pytest.approx((1e-3, 5e-3), rel=0.01)
    assert memory.error < 1e-3


def test_fit_refuses_what_has_not_turned_or_was_fed():
    once = SimpleNamespace(stroke=np.array([1, 1]))
    with pytest.raises(ValueError, match="must have turned back, got 1 stroke"):
        fitted(once)
    with pytest.raises(ValueError, match="must go back over what it pressed"):
        fitted(made(fed=0.05))


def test_fit_refuses_a_way_back_shorter_than_the_contact():
    short = made()
    short.leading = np.full_like(short.leading, 0.2)
    with pytest.raises(ValueError, match="must go back farther than its contact, got 0 steps"):
        fitted(short)


def test_memory_refuses_what_it_cannot_be():
    with pytest.raises(ValueError, match="`release` must be positive and finite"):
        PressedMemory(800.0, 50.0, 0.0, 1e-2)
    with pytest.raises(ValueError, match="`distance` must be zero or positive"):
        MEMORY.resistance(-1e-3)
