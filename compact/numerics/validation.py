"""Refusals at a public door: name in back-ticks, rule, value got."""

import numpy as np

OPPOSING_SPEEDS = np.array([1.0, 0.5, 0.1, 0.01])  # [-], of a speed that a run reaches; slower is next to standing
OPPOSING_ROUNDING = 1e-9  # [-], of the largest force: a wrong sign below it is rounding


class NotFiniteError(ValueError):
    """A quantity holds nan or an infinity."""


def _refuse_unless(holds, rule, quantities):
    for name, value in quantities.items():
        # a comparison with nan is false, so nan is refused too; numbers are many, and arrays of them slow
        if not (holds(value) if isinstance(value, float) else np.all(holds(np.asarray(value)))):
            raise ValueError(f"`{name}` must be {rule}, got {shown(value, holds)}")


def shown(value, holds):
    """The value itself, or of a large array the first element that breaks the rule and its place."""
    array = np.asarray(value)
    if array.size <= 4:
        return f"{array.tolist()!r}"
    place = tuple(int(i) for i in np.argwhere(~holds(array))[0])
    return f"{array[place].item()!r} at index {place if len(place) > 1 else place[0]}"


def require_positive(**quantities):
    """Refuse any quantity that is not finite and > 0 throughout."""
    _refuse_unless(lambda value: (value > 0) & (value < np.inf), "positive and finite", quantities)


def require_nonnegative(**quantities):
    """Refuse any quantity that is not finite and >= 0 throughout."""
    _refuse_unless(lambda value: (value >= 0) & (value < np.inf), "zero or positive, and finite", quantities)


def require_finite(**quantities):
    """Refuse any quantity that holds nan or an infinity."""
    try:
        _refuse_unless(np.isfinite, "finite", quantities)
    except ValueError as error:
        raise NotFiniteError(str(error)) from None


def require_between(low, high, **quantities):
    """Refuse any quantity outside the closed interval [low, high]."""
    _refuse_unless(lambda value: (value >= low) & (value <= high), f"between {low:g} and {high:g}", quantities)


def require_integers(**quantities):
    """Refuse any quantity that is not a whole number >= 1 throughout."""
    for name, value in quantities.items():
        count = np.asarray(value)
        whole = (count >= 1) & (count < np.inf) & (count == np.floor(count))
        require_that(whole, value, f"`{name}` must be a whole number >= 1, got")


def require_that(holds, value, rule):
    """Refuse with `rule` and the value, or the first element of it, where `holds` is not true throughout."""
    if not np.all(holds):
        raise ValueError(f"{rule} {shown(value, lambda _: holds)}")


def require_at_most(limit, remedy, **counts):
    """Require counts that a user gives to be at most `limit`, before anything of that size is made."""
    for name, count in counts.items():
        if count > limit:
            raise ValueError(f"`{name}` must be at most {limit}, got {count}; {remedy}")


def require_opposing(resistance, speed, *, ways=(1.0, -1.0)):
    """Require a resistance that opposes the motion at speeds up to `speed` [m/s].

        v R(v, 0) >= 0

    Parameters
    ----------
    resistance : callable(velocity, acceleration) -> N. A resistance whose attribute `odd` is true changes its sign
        with the velocity by construction; it is accepted with either sign, as a driven roller pulls its cart
    speed : a speed that the run reaches [m/s], > 0
    ways : signs of the velocities that the run reaches

    Raises ValueError with the first velocity at which the resistance would push the cart on.

    >>> require_opposing(lambda velocity, acceleration: 3500.0, 0.1)
    Traceback (most recent call last):
    ValueError: `resistance` must oppose the motion, got 3500 N at velocity -0.1 m/s: it would push the cart on; \
give a function that changes its sign with the velocity, for a constant force `compact.dry_resistance(3500)`
    """
    if getattr(resistance, "odd", False):
        return
    velocity = np.outer(ways, speed * OPPOSING_SPEEDS).ravel()
    force = np.broadcast_to(np.asarray(resistance(velocity, np.zeros(velocity.shape)), float), velocity.shape)
    pushes = np.sign(velocity) * force < -OPPOSING_ROUNDING * np.abs(force).max()
    if pushes.any():
        v, pushed = velocity[pushes][0], force[pushes][0]
        raise ValueError(
            f"`resistance` must oppose the motion, got {pushed:g} N at velocity {v:g} m/s: it would push the cart on; "
            "give a function that changes its sign with the velocity, for a constant force "
            f"`compact.dry_resistance({abs(pushed):g})`"
        )


def require_known(kind, name, choices):
    """Refuse a name that is not among the choices, naming them and the nearest one."""
    if name not in choices:
        from difflib import get_close_matches

        near = get_close_matches(str(name), choices, n=1)
        hint = f"did you mean '{near[0]}'? " if near else ""
        raise ValueError(f"no {kind} '{name}'; {hint}choose from {', '.join(choices)}")
