"""Checks of arguments at public functions.

An error message contains the name in back-ticks, the rule, the value received and, where possible, the remedy.
"""

import reprlib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import fields
from difflib import get_close_matches
from importlib.metadata import entry_points
from numbers import Real
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from compact.numerics import Array

OPPOSING_SPEEDS = np.array([1.0, 0.5, 0.1, 0.01])  # [-], test speeds over the given speed; slower ones are near rest
OPPOSING_ROUNDING = 1e-9  # [-], force over the largest force; a wrong sign below it is rounding
MAX_SHOWN = 4  # [-], elements of an array that a message contains in full

Condition = Callable[[Any], Any]
T = TypeVar("T")


class NotFiniteError(ValueError):
    """Error for a quantity that contains nan or an infinity."""


def as_numbers(name: str, value: object) -> Array:
    """Return a real number, or nested lists of them, as an array; raise ValueError for text, None and complex numbers.

    Parameters
    ----------
    name : str
        Name of the argument, for the message.
    """
    try:
        array = np.asarray(value)
        if array.dtype.kind == "O" and all(isinstance(each, Real) for each in array.flat):
            array = array.astype(float)  # whole numbers beyond 64 bits, fractions
    except (ValueError, OverflowError):  # lists of different lengths, numbers beyond 1.8e308
        array = np.array(None)
    if array.dtype.kind not in "biuf":
        raise ValueError(f"`{name}` must be real numbers below 1.8e308, got {reprlib.repr(value)}; give SI units")
    return array


def require_number(**quantities: object) -> None:
    """Require single real numbers; raise ValueError otherwise."""
    for name, value in quantities.items():
        if not isinstance(value, float) and as_numbers(name, value).ndim:
            raise ValueError(f"`{name}` must be one number, got {reprlib.repr(value)}")


def require_instance(kind: Any, words: str, **values: object) -> None:
    """Require instances of a class, which `words` name; raise ValueError otherwise."""
    for name, value in values.items():
        if not isinstance(value, kind):
            raise ValueError(f"`{name}` must be {words}, got {reprlib.repr(value)}")


def _require(condition: Condition, rule: str, quantities: Mapping[str, ArrayLike], error: type = ValueError) -> None:
    for name, value in quantities.items():
        # a comparison with nan is false, so that nan is refused; plain floats avoid the cost of an array
        if not (condition(value) if isinstance(value, float) else np.all(condition(as_numbers(name, value)))):
            raise error(f"`{name}` must be {rule}, got {_shown(value, condition)}")


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
    _require(np.isfinite, "finite", quantities, NotFiniteError)


def require_fields(record: Any, *, positive: str = "", nonnegative: str = "", finite: str = "") -> None:
    """Require the named fields of a record, separated by blanks, to be valid; None is where it is the default."""
    optional = {each.name for each in fields(record) if each.default is None}
    for require, names in ((require_nonnegative, nonnegative), (require_positive, positive), (require_finite, finite)):
        values = {name: getattr(record, name) for name in names.split()}
        require(**{name: value for name, value in values.items() if value is not None or name not in optional})


def require_between(low: float, high: float, **quantities: ArrayLike) -> None:
    """Require all elements to lie in the closed interval [low, high]; raise ValueError otherwise."""
    _require(lambda value: (value >= low) & (value <= high), f"between {low:g} and {high:g}", quantities)


def require_inside(low: float, high: float, **quantities: ArrayLike) -> None:
    """Require all elements to lie in the open interval (low, high); raise ValueError otherwise."""
    _require(lambda value: (value > low) & (value < high), f"above {low:g} and below {high:g}", quantities)


def require_integers(**quantities: ArrayLike) -> None:
    """Require all elements to be whole numbers >= 1; raise ValueError otherwise."""
    _require(
        lambda value: (value >= 1) & (value < np.inf) & (value == np.floor(value)), "a whole number >= 1", quantities
    )


def require_that(condition: ArrayLike, value: ArrayLike, rule: str) -> None:
    """Require a condition of the shape of a value to be true throughout; `rule` begins the message, up to "got"."""
    if not np.all(condition):
        raise ValueError(f"{rule} {_shown(value, lambda _: condition)}")


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
    if not callable(resistance):
        raise ValueError(
            f"`resistance` must be a function of velocity and acceleration, got {reprlib.repr(resistance)}; for a "
            "constant force use `compact.dry_resistance`"
        )
    velocity = np.outer(list(directions), speed * OPPOSING_SPEEDS).ravel()
    force = as_numbers("resistance", resistance(velocity, np.zeros(velocity.shape)))
    force = np.broadcast_to(np.asarray(force, float), velocity.shape)
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
    if not isinstance(name, str) or name not in choices:
        matches = get_close_matches(str(name), choices, n=1)
        hint = f"did you mean '{matches[0]}'? " if matches else ""
        raise ValueError(f"no {kind} '{name}'; {hint}choose from {', '.join(choices)}")


class Registry(Mapping[str, T]):
    """Objects by name: those of this package, then those that other packages add by an entry point.

    Parameters
    ----------
    kind : type
        Class of the objects, which have a `name`.
    group : str
        Group of the entry points; an object of another package is loaded when first used.
    own : iterable
        Objects of this package.
    """

    def __init__(self, kind: type[T], group: str, own: Iterable[Any]) -> None:
        self.kind, self.group = kind, group
        self.own: dict[str, T] = {each.name: each for each in own}

    @property
    def installed(self) -> tuple[str, ...]:
        """Names of the objects of other packages."""
        return tuple(name for name in entry_points(group=self.group).names if name not in self.own)

    def __getitem__(self, name: str) -> T:
        if name in self.own:
            return self.own[name]
        for entry in entry_points(group=self.group, name=name):
            found: Any = entry.load()
            if not isinstance(found, self.kind) or found.name != name:  # type: ignore[attr-defined]
                raise ValueError(
                    f"the entry point {name} of the group {self.group} must be of class {self.kind.__name__} and "
                    f"called {name!r}, got {found!r}"
                )
            return found
        raise KeyError(name)

    def __iter__(self) -> Iterator[str]:
        return iter((*self.own, *self.installed))

    def __len__(self) -> int:
        return len(list(iter(self)))
