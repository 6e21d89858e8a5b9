"""Results of the contact of one roller as typed records, and the file that keeps them for the next run.

A `ContactRecord` holds the scalar results of one contact, a `PassRecord` those of one pass over a layer with
irreversible compaction. Dictionaries with units exist in JSON only; `contact_to_json` and `contact_from_json` convert.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from compact import quantities
from compact.files import write_json
from compact.rolling_contact import ContactResult

COMPACTED = (  # fields of engines with irreversible compaction only
    "exit_density_ratio", "exit_height", "peak_density_ratio", "mass_residual", "yield_residual", "equilibrium_residual",
)  # fmt: skip
COMMON = tuple(name for name in quantities.CONTACT if name not in COMPACTED)
ERRORS = {"load": "load_error", "resistance": "resistance_error"}  # quantity -> field of its relative error


@dataclass(frozen=True)
class PassRecord:
    """Scalar results of one pass of a roller over a layer with irreversible compaction.

    Parameters
    ----------
    load, resistance : float
        Force on the roller per unit length [N/m].
    indentation : float
        Depth of the lowest generatrix below the surface of the layer before the pass [m].
    exit_height : float
        Height of the layer behind the roller [m].
    exit_density_ratio : float
        Mean density ratio of the layer behind the roller [-].
    work_residual, mass_residual : float or None
        Relative residuals of the balances of energy and mass [-].
    """

    load: float
    resistance: float
    indentation: float
    exit_height: float
    exit_density_ratio: float
    work_residual: float | None
    mass_residual: float | None


@dataclass(frozen=True)
class ContactRecord:
    """Scalar results of the contact of one roller at one speed.

    Parameters
    ----------
    engine : str
        Name of the engine.
    speed : float
        Speed of the roller [m/s].
    load, resistance : float
        Force on the roller per unit length [N/m].
    load_error, resistance_error : float or None
        Relative error estimates [-]; None where the engine has none.
    coefficient : float
        Rolling-resistance coefficient, resistance over load [-].
    leading, trailing : float
        Edges of the contact from the axis of the roller, positive along the travel [m].
    peak_pressure : float
        Largest contact pressure [Pa].
    indentation : float or None
        Depth of the lowest generatrix below the surface [m]; None on a half-plane.
    creep : float or None
        Creepage of a roller with stick and slip [-].
    work_residual : float or None
        Relative residual of the energy balance [-].
    iterations : int
        Number of iterations of the engine.
    exit_density_ratio, exit_height, mass_residual : float or None
        Mean density ratio [-] and height [m] behind the first pass, relative residual of the mass balance [-];
        None for a linear layer.
    peak_density_ratio, yield_residual, equilibrium_residual : float or None
        Largest density ratio, largest stress beyond the cap over its pressure and relative residual of the forces
        [-]; None except for the engine "compaction".
    passes : tuple of PassRecord
        All passes in order; empty for a linear layer.
    """

    engine: str
    speed: float
    load: float
    load_error: float | None
    resistance: float
    resistance_error: float | None
    coefficient: float
    leading: float
    trailing: float
    peak_pressure: float
    indentation: float | None
    creep: float | None
    work_residual: float | None
    iterations: int
    exit_density_ratio: float | None = None
    exit_height: float | None = None
    peak_density_ratio: float | None = None
    mass_residual: float | None = None
    yield_residual: float | None = None
    equilibrium_residual: float | None = None
    passes: tuple[PassRecord, ...] = ()


def contact_record(engine: str, speed: float, passes: tuple[ContactResult, ...]) -> ContactRecord:
    """Summarise the results of all passes at one speed; all but `passes` belongs to the first.

    Parameters
    ----------
    engine : str
        Name of the engine.
    speed : float
        Speed of the roller [m/s].
    passes : tuple of ContactResult
        Results of the passes in order, at least one.

    Returns
    -------
    ContactRecord
    """
    first = passes[0]
    load_error, resistance_error = first.error or (None, None)
    compacting = hasattr(first, "exit_height")
    return ContactRecord(
        engine=engine,
        speed=speed,
        load=first.load,
        load_error=load_error,
        resistance=first.resistance,
        resistance_error=resistance_error,
        coefficient=first.resistance / first.load,
        leading=first.leading,
        trailing=first.trailing,
        peak_pressure=first.peak_pressure,
        indentation=getattr(first, "indentation", None),
        creep=getattr(first, "creep", None),
        work_residual=first.work_residual,
        iterations=len(first.history),
        **{name: getattr(first, name, None) for name in COMPACTED},
        passes=tuple(_pass_record(each) for each in passes) if compacting else (),
    )


def _pass_record(result: ContactResult) -> PassRecord:
    return PassRecord(**{name: getattr(result, name) for name in quantities.PASS})


def contact_to_json(contact: ContactRecord) -> dict[str, Any]:
    """Convert a record to nested dictionaries with "value", "unit" and, where there is an estimate, "error".

    Parameters
    ----------
    contact : ContactRecord

    Returns
    -------
    dict
        In the form of "contacts" in summary.json.
    """
    content: dict[str, Any] = {"engine": contact.engine}
    for name in COMMON:
        content[name] = _with_unit(contact, name)
        if name in ERRORS:
            content[name]["error"] = getattr(contact, ERRORS[name])
    content["iterations"] = contact.iterations
    content |= {name: _with_unit(contact, name) for name in COMPACTED if getattr(contact, name) is not None}
    if contact.passes:
        content["passes"] = [{name: _with_unit(each, name) for name in quantities.PASS} for each in contact.passes]
    return content


def _with_unit(record: ContactRecord | PassRecord, name: str) -> dict[str, Any]:
    return {"value": getattr(record, name), "unit": quantities.CONTACT[name].unit}


def contact_from_json(content: dict[str, Any]) -> ContactRecord:
    """Read a record back from the form of `contact_to_json`.

    Parameters
    ----------
    content : dict

    Returns
    -------
    ContactRecord

    Raises
    ------
    KeyError, TypeError
        If `content` has another form.
    """
    values = {name: content[name]["value"] for name in COMMON}
    errors = {field: content[name]["error"] for name, field in ERRORS.items()}
    compacted = {name: content[name]["value"] for name in COMPACTED if name in content}
    passes = tuple(
        PassRecord(**{name: each[name]["value"] for name in quantities.PASS}) for each in content.get("passes", ())
    )
    return ContactRecord(
        engine=content["engine"], iterations=content["iterations"], passes=passes, **values, **errors, **compacted
    )


def write_contacts(path: Path, contacts: list[ContactRecord], more: dict[str, Any], key: str, files: list[str]) -> None:
    """Write records as JSON for the next run in the same directory.

    Parameters
    ----------
    path : Path
        File to write.
    contacts : list of ContactRecord
    more : dict
        Further results of the contacts.
    key : str
        Hash of all inputs of the contacts.
    files : list of str
        Result files that depend on the contacts alone.
    """
    content = [contact_to_json(contact) for contact in contacts]
    write_json(path, {"key": key, "contacts": content, "more": more, "files": files})


def read_contacts(path: Path, key: str) -> tuple[list[ContactRecord], dict[str, Any], list[str]]:
    """Read the records, the further results and the names of result files that `write_contacts` wrote.

    Parameters
    ----------
    path : Path
        File to read.
    key : str
        Hash of all inputs of the contacts.

    Returns
    -------
    tuple
        `contacts`, `more` and `files` of `write_contacts`.

    Raises
    ------
    ValueError
        If the file has another key or another form.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        found, more, files = (content[name] for name in ("key", "more", "files"))
        contacts = [contact_from_json(each) for each in content["contacts"]]
    except (KeyError, TypeError, ValueError) as wrong:
        raise ValueError(f"{path}: no file of contacts ({wrong}); compute them again") from None
    if found != key:
        raise ValueError(f"{path}: key {found}, required {key}; compute the contacts again")
    return contacts, more, files
