"""Contacts and resistance map that a results directory keeps for the next run.

Kept results serve every scene with the same key: the same roller, layer, mix, contact, accuracy, engine, speeds, tables
of the mix, versions and sources. Cart, laws, drive and output are not in the key. If a file has changed, none is used.
The uncertainty of the ranking depends on all of the scene, and has a key of its own.
"""

import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import TypeAdapter
from pydantic_core import to_jsonable_python

from compact import resistance
from compact.analysis import contact_cases
from compact.analysis.contact_cases import HeldQuantity
from compact.analysis.pore_air import AirCurve
from compact.engines import ENGINES
from compact.files import checksum, read_checked, results_key, write_checked
from compact.material.mix import Mix
from compact.resistance import ResistanceMap
from compact.rolling_contact import Contact
from compact.scene.loader import Scene

if TYPE_CHECKING:
    from compact.analysis.stages.uncertainty import Uncertainties
    from compact.analysis.stages.verdict import ModelSpread
    from compact.engines.process.lifts import KnownLifts

MAP_FILE, CONTACTS_FILE = "resistance.nc", "contacts.json"
KEPT_FILES = (  # prefixes of files that depend on the contacts alone
    "passes.csv", "density.csv", "pressure.png", "fields.pvd", "fields.png", "fields/",
)  # fmt: skip
CART_KEYS = {  # of [machine], on which no layered engine depends
    *("mass", "weight", "roller_positions", "guide_positions", "pin_position", "pin_height", "guide_wheel_diameter"),
    *("guide_friction", "journal_diameter", "bearing_friction", "rolling_arm", "rib_factor", "roller_friction"),
    *("feeder_sleeve", "sleeve_distance", "overlap", "pressure_nonuniformity", "one_sided"),
}
RECORDS: dict[str, Callable[[], Any]] = {  # types of the results in JSON
    "held": lambda: HeldQuantity,
    "second_pass": lambda: tuple[float, float],
    "air_curve": lambda: AirCurve,
    "model_spread": lambda: import_module("compact.analysis.stages.verdict").ModelSpread,
    "prior": lambda: tuple[float, float],
    "lifts": lambda: import_module("compact.engines.process.lifts").KnownLifts,  # with the finite elements
    "uncertainty": lambda: import_module("compact.analysis.stages.uncertainty").Uncertainties,
}
_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class KeptResults:
    """Results of an earlier run.

    Parameters
    ----------
    key : str
        Key of the contacts, see `contacts_key`.
    second_pass : tuple of float or None
        Load and resistance of a second pass over those of the first [-].
    air_curve : AirCurve or None
        Forces of the pore air over speed/permeability.
    model_spread : ModelSpread or None
        Contacts by the other laws of the mix.
    lifts : KnownLifts or None
        Lumped lifts of a forming process in two dimensions.
    prior : tuple of float or None
        Load on a roller and resistance of a cart with nothing fitted [N].
    uncertainty : dict of str to RankingUncertainty
        Uncertainty of the ranking by the key of the whole scene to which it belongs; empty without it.
    """

    key: str
    contacts: list[Contact]
    held: HeldQuantity
    second_pass: tuple[float, float] | None
    resistance_map: ResistanceMap
    air_curve: AirCurve | None = None
    model_spread: "ModelSpread | None" = None
    lifts: "KnownLifts | None" = None
    files: tuple[str, ...] = ()
    prior: tuple[float, float] | None = None
    uncertainty: "Uncertainties" = field(default_factory=dict)


def contacts_key(scene: Scene, mix: Mix) -> str:
    """Hash all inputs of the contacts and the resistance map of a scene.

    Returns
    -------
    str
        SHA-256, hexadecimal.
    """
    engine = ENGINES[scene.accuracy.engine]
    inputs = {
        "machine": scene.machine.model_dump(exclude=CART_KEYS),
        "height": scene.lift_thickness,
        "mix": [scene.mix.model_dump(exclude={"overrides"}), {each.name: each.value for each in mix.parameters}],
        "layer": scene.layer.model_dump(),
        "contact": scene.contact and scene.contact.model_dump(),
        "accuracy": scene.accuracy.model_dump(),
        "speeds": contact_cases.contact_speeds(scene),
        "engine": engine.source,
    }
    if engine.reads("process"):
        whole = {name: getattr(scene, name) for name in ("process", "sleeve", "motion")}
        inputs["strokes"] = {name: table and table.model_dump(mode="json") for name, table in whole.items()}
        inputs["laws"] = scene.checksums["motion.tables"]
    return results_key(inputs)


def read_results(directory: Path, key: str) -> KeptResults | None:
    """Read the results of an earlier run; None without results, under another key of `contacts_key`, or damaged."""
    path = directory / CONTACTS_FILE
    if not path.is_file():
        return None
    try:
        content = read_checked(path)
        if key not in content:
            _LOG.warning("%s: of another program, table or input; its contacts are computed again", path)
            return None
        kept, more = content[key], content[key]["more"]
        if any(checksum((directory / name).read_bytes()) != known for name, known in kept["files"].items()):
            _LOG.warning("%s: a file of its results has changed; its contacts are computed again", path)
            return None
        records = {
            name: more[name] and TypeAdapter(kind()).validate_python(more[name]) for name, kind in RECORDS.items()
        }
        return KeptResults(
            key=key,
            contacts=[Contact.from_json(each) for each in kept["contacts"]],
            resistance_map=resistance.load_resistance_map(directory / MAP_FILE),
            files=tuple(kept["files"]),
            **records,
        )
    except (OSError, ValueError, KeyError, TypeError):  # no file, or a file of another form
        _LOG.warning("%s: damaged, or of another version; its contacts are computed again", path)
        return None


def write_results(directory: Path, results: KeptResults) -> Iterator[Path]:
    """Write results for the next run, of their files those that depend on the contacts alone; yield the paths."""
    path = directory / CONTACTS_FILE
    path.unlink(missing_ok=True)  # it lists the valid files: removed first, written last
    results.resistance_map.save(directory / MAP_FILE)
    names = [MAP_FILE, *(name for name in results.files if name.startswith(KEPT_FILES))]
    more = {name: to_jsonable_python(getattr(results, name)) for name in RECORDS}
    more["lifts"] = results.lifts and results.lifts.to_json()
    content = {
        "contacts": [contact.to_json() for contact in results.contacts],
        "more": more,
        "files": {name: checksum((directory / name).read_bytes()) for name in names if (directory / name).is_file()},
    }
    write_checked(path, {results.key: content})
    yield directory / MAP_FILE
    yield path
