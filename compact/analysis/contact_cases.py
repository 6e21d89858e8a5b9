"""The contact of a scene in numbers, and the file that keeps them for the next run."""

import json

from compact.files import write_json


def numbers(engine, speed, passes):
    """Headline numbers of one contact: value and unit, with the engine's own relative error where it has one; where mix
    stays pressed, what all passes take and leave besides."""
    rolled = passes[0]
    load_error, resistance_error = rolled.error or (None, None)
    return (
        {
            "engine": engine,
            "speed": {"value": speed, "unit": "m/s"},
            "load": {"value": rolled.load, "unit": "N/m", "error": load_error},
            "resistance": {"value": rolled.resistance, "unit": "N/m", "error": resistance_error},
            "coefficient": {"value": rolled.resistance / rolled.load, "unit": "1"},
            "leading": {"value": rolled.leading, "unit": "m"},
            "trailing": {"value": rolled.trailing, "unit": "m"},
            "peak_pressure": {"value": rolled.peak_pressure, "unit": "Pa"},
            "indentation": {"value": getattr(rolled, "indentation", None), "unit": "m"},  # none on a half-plane
            "creep": {"value": getattr(rolled, "creep", None), "unit": "1"},  # of a roller that sticks and slips
            "work_residual": {"value": rolled.work_residual, "unit": "1"},
            "iterations": len(rolled.history),
        }
        | {
            name: {"value": getattr(rolled, name), "unit": unit}
            for name, unit in COMPACTED.items()
            if hasattr(rolled, name)
        }
        | ({"passes": [_pass_numbers(passed) for passed in passes]} if hasattr(rolled, "exit_height") else {})
    )


def _pass_numbers(passed):
    return {name: {"value": getattr(passed, name), "unit": unit} for name, unit in PASSED.items()}


PASSED = {
    "load": "N/m",
    "resistance": "N/m",
    "indentation": "m",
    "exit_height": "m",
    "exit_density_ratio": "1",
    "work_residual": "1",
    "mass_residual": "1",
}
COMPACTED = {  # what engines of a layer that stays pressed know besides
    "exit_density_ratio": "1",
    "exit_height": "m",
    "peak_density_ratio": "1",
    "mass_residual": "1",
    "yield_residual": "1",
    "equilibrium_residual": "1",
}


def value(contact, name):
    """One number of a contact, and the engine's relative error of it, or None."""
    return contact[name]["value"], contact[name].get("error")


def save(path, contacts, more, key, files):
    """Write the numbers of contacts as JSON, with more that was found of them, the key of all they depend on and the
    files that describe them."""
    write_json(path, {"key": key, "contacts": contacts, "more": more, "files": files})


def load(path, key):
    """(numbers of contacts, more that was found, files that describe them) of a file.

    Raises ValueError where it has another key or is no such file.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        made, contacts, more, files = (content[name] for name in ("key", "contacts", "more", "files"))
    except (KeyError, TypeError, ValueError) as wrong:
        raise ValueError(f"{path}: no contacts: {wrong}; compute them again") from None
    if made != key:
        raise ValueError(f"{path}: made under key {made}, wanted {key}; compute them again")
    return contacts, more, files
