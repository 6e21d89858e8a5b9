"""Refusals at a public door: name in back-ticks, rule, value got."""

import numpy as np


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


def refuse_nonpositive(**quantities):
    """Refuse any quantity that is not finite and > 0 throughout."""
    _refuse_unless(lambda value: (value > 0) & (value < np.inf), "positive and finite", quantities)


def refuse_negative(**quantities):
    """Refuse any quantity that is not finite and >= 0 throughout."""
    _refuse_unless(lambda value: (value >= 0) & (value < np.inf), "zero or positive, and finite", quantities)


def refuse_nonfinite(**quantities):
    """Refuse any quantity that holds nan or an infinity."""
    try:
        _refuse_unless(np.isfinite, "finite", quantities)
    except ValueError as error:
        raise NotFiniteError(str(error)) from None


def refuse_outside(low, high, **quantities):
    """Refuse any quantity outside the closed interval [low, high]."""
    _refuse_unless(lambda value: (value >= low) & (value <= high), f"between {low:g} and {high:g}", quantities)


def refuse_fractional(**quantities):
    """Refuse any quantity that is not a whole number >= 1 throughout."""
    for name, value in quantities.items():
        count = np.asarray(value)
        whole = (count >= 1) & (count < np.inf) & (count == np.floor(count))
        refuse_unless(whole, value, f"`{name}` must be a whole number >= 1, got")


def refuse_unless(holds, value, rule):
    """Refuse with `rule` and the value, or the first element of it, where `holds` is not true throughout."""
    if not np.all(holds):
        raise ValueError(f"{rule} {shown(value, lambda _: holds)}")


def refuse_unknown(kind, name, choices):
    """Refuse a name that is not among the choices, naming them and the nearest one."""
    if name not in choices:
        from difflib import get_close_matches

        near = get_close_matches(str(name), choices, n=1)
        hint = f"did you mean '{near[0]}'? " if near else ""
        raise ValueError(f"no {kind} '{name}'; {hint}choose from {', '.join(choices)}")
