"""Checks of arguments at public functions.

An error message contains the name in back-ticks, the rule, the value received and, where possible, the remedy.
"""

from collections.abc import Callable, Collection, Iterable
from difflib import get_close_matches
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from compact.numerics import Array

OPPOSING_SPEEDS = np.array([1.0, 0.5, 0.1, 0.01])  # [-], test speeds over the given speed; slower ones are near rest
OPPOSING_ROUNDING = 1e-9  # [-], force over the largest force; a wrong sign below it is rounding
MAX_SHOWN = 4  # [-], elements of an array that a message contains in full

Condition = Callable[[Any], Any]


class NotFiniteError(ValueError):
    """Error for a quantity that contains nan or an infinity."""


def _require(condition: Condition, rule: str, quantities: dict[str, ArrayLike]) -> None:
    for name, value in quantities.items():
        # a comparison with nan is false, so that nan is refused; plain floats avoid the cost of an array
        if not (condition(value) if isinstance(value, float) else np.all(condition(np.asarray(value)))):
            raise ValueError(f"`{name}` must be {rule}, got {_shown(value, condition)}")


def _shown(value: ArrayLike, condition: Condition) -> str:
    """Text of a value; of a large array the first element that violates the condition, with its index."""
    array = np.asarray(value)
    if array.size <= MAX_SHOWN:
        return f"{array.tolist()!r}"
    place = tuple(int(i) for i in np.argwhere(~condition(array))[0])
    return f"{array[place].item()!r} at index {place if len(place) > 1 else place[0]}"


def require_positive(**quantities: ArrayLike) -> None:
    """Require all elements to be finite and > 0; raise ValueError otherwise."""
    _require(lambda value: (value > 0) & (value < np.inf), "positive and finite", quantities)


def require_nonnegative(**quantities: ArrayLike) -> None:
    """Require all elements to be finite and >= 0; raise ValueError otherwise."""
    _require(lambda value: (value >= 0) & (value < np.inf), "zero or positive, and finite", quantities)


def require_finite(**quantities: ArrayLike) -> None:
    """Require all elements to be finite; raise NotFiniteError otherwise."""
    try:
        _require(np.isfinite, "finite", quantities)
    except ValueError as error:
        raise NotFiniteError(str(error)) from None


def require_fields(record: Any, *, positive: str = "", nonnegative: str = "", finite: str = "") -> None:
    """Require the named fields of a record, separated by blanks, to be valid unless they are None."""
    for require, names in ((require_nonnegative, nonnegative), (require_positive, positive), (require_finite, finite)):
        values = {name: getattr(record, name) for name in names.split()}
        require(**{name: value for name, value in values.items() if value is not None})


def require_between(low: float, high: float, **quantities: ArrayLike) -> None:
    """Require all elements to lie in the closed interval [low, high]; raise ValueError otherwise."""
    _require(lambda value: (value >= low) & (value <= high), f"between {low:g} and {high:g}", quantities)


def require_integers(**quantities: ArrayLike) -> None:
    """Require all elements to be whole numbers >= 1; raise ValueError otherwise."""
    for name, value in quantities.items():
        count = np.asarray(value)
        whole = (count >= 1) & (count < np.inf) & (count == np.floor(count))
        require_that(whole, value, f"`{name}` must be a whole number >= 1, got")


def require_that(condition: ArrayLike, value: ArrayLike, rule: str) -> None:
    """Require a condition of the shape of a value to be true throughout; `rule` begins the message, up to "got"."""
    if not np.all(condition):
        raise ValueError(f"{rule} {_shown(value, lambda _: condition)}")


def require_at_most(limit: int, remedy: str, **counts: int) -> None:
    """Require counts to be at most `limit`; raise ValueError with the remedy otherwise."""
    for name, count in counts.items():
        if count > limit:
            raise ValueError(f"`{name}` must be at most {limit}, got {count}; {remedy}")


def require_opposing(
    resistance: Callable[[Array, Array], ArrayLike], speed: float, *, directions: Iterable[float] = (1.0, -1.0)
) -> None:
    """Require a resistance that opposes the motion at speeds up to a given speed.

        v R(v, 0) >= 0

    Parameters
    ----------
    resistance : callable
        R(velocity [m/s], acceleration [m/s2]) [N]. A resistance whose attribute `odd` is true is accepted with either
        sign: it changes its sign with the velocity by construction, and a driven roller pulls its cart.
    speed : float
        Speed that the cart reaches [m/s], > 0.
    directions : iterable of float
        Signs of the velocities that the cart reaches.

    Examples
    --------
    >>> require_opposing(lambda velocity, acceleration: 3500.0, 0.1)
    Traceback (most recent call last):
    ValueError: `resistance` must oppose the motion, got 3500 N at velocity -0.1 m/s: it would accelerate the cart; \
use a function that changes its sign with the velocity, for a constant force `compact.dry_resistance(3500)`
    """
    if getattr(resistance, "odd", False):
        return
    velocity = np.outer(list(directions), speed * OPPOSING_SPEEDS).ravel()
    force = np.broadcast_to(np.asarray(resistance(velocity, np.zeros(velocity.shape)), float), velocity.shape)
    accelerates = np.sign(velocity) * force < -OPPOSING_ROUNDING * np.abs(force).max()
    if accelerates.any():
        v, wrong = velocity[accelerates][0], force[accelerates][0]
        raise ValueError(
            f"`resistance` must oppose the motion, got {wrong:g} N at velocity {v:g} m/s: it would accelerate the "
            "cart; use a function that changes its sign with the velocity, for a constant force "
            f"`compact.dry_resistance({abs(wrong):g})`"
        )


def require_known(kind: str, name: object, choices: Collection[str]) -> None:
    """Require a name of a kind among the choices; the message contains the closest choice and all choices."""
    if name not in choices:
        matches = get_close_matches(str(name), choices, n=1)
        hint = f"did you mean '{matches[0]}'? " if matches else ""
        raise ValueError(f"no {kind} '{name}'; {hint}choose from {', '.join(choices)}")
