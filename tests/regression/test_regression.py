"""Regression of seven scenes: their numbers in `summary.json`, `ranking.csv` and the contact tables.

Each scene is a variant of `compact/data/scenes/small.toml`. The expected numbers are kept in `tests/regression/*.json`;
`python tests/regression/test_regression.py` writes them anew, `--exact` compares them bit for bit.
"""

import csv
import json
import math
import sys
import tempfile
from pathlib import Path

import pytest
from drive_tables import HYDRAULICS, MOTOR

from compact.analysis.study import Study
from compact.report import writer as report
from compact.scene.loader import load_scene

HERE = Path(__file__).parent
SMALL = HERE.parents[1] / "compact" / "data" / "scenes" / "small.toml"
RELATIVE = 1e-6  # [-]; between machines, whose libraries round differently
ESTIMATE = 1e-4  # [-], of an error or residual, a difference of nearly equal numbers that is told to two digits
ABSOLUTE = 1e-9  # of quantities that are zero but for rounding
UNSTABLE = {"versions", "scene_hash", "files", "counts", "warnings", "advice", "inputs"}  # advice names the path
TABLES = ("ranking.csv", "contact.csv")

CONTACT = {"contact.speeds": [0.05, 0.2], "contact.indentation": 0.002, "output.items": ["tables"]}
ELASTIC = {"drive.kind": "elastic", "drive.stiffness": 1e6, "drive.damping": 3e3, "drive.backlash": 1e-4}
SCENES = {
    "formula": {"output.items": ["tables", "cams", "reactions", "crank"]},
    "column": {"accuracy.engine": "column", "contact.speeds": [0.05, 0.2], "output.items": ["tables"]} | ELASTIC,
    "spectral": {
        "accuracy.engine": "spectral", "machine.roller_condition": "frictionless", "machine.gap_geometry": "circle",
        "drive.kind": "motor", "drive.motor": MOTOR,
    } | CONTACT,
    "fem": {
        "accuracy.engine": "fem", "accuracy.tolerance": 0.05, "drive.kind": "hydraulic", "drive.hydraulics": HYDRAULICS,
        "compare": {"spectral": {"machine": {"roller_condition": "frictionless", "gap_geometry": "circle"}}},
    } | CONTACT,
    "compaction": {
        "accuracy.engine": "compaction", "accuracy.tolerance": 0.3, "product.height": 0.03,
        "layer.fed_density_ratio": 0.94, "machine.gap_geometry": "deformed", "mix.overrides.unloading_modulus": 60e6,
        "mix.overrides.friction_angle": 44.0, "mix.overrides.heckel_slope": 11.5e-6,
    } | CONTACT | {"contact.speeds": [0.2], "contact.indentation": 0.001},
    "process": {
        "accuracy.engine": "process", "machine.roller_length": 0.2, "mix.density_ratio": 0.9,
        "layer.fed_density_ratio": 0.8, "motion.duration": 1.0, "motion.other_durations": [0.8],
        "process": {
            "mould_speed": 0.015, "feed_density_ratio": 0.75, "feeds": "forward", "product_density_ratio": 0.9,
            "detail": "columns", "layers": 2,
        },
        "sleeve": {"width": 0.18, "head": 0.5, "wall_friction": 0.35, "count": 2}, "output.items": ["tables"],
    },
    "optimised": {
        "motion.optimise": {"objectives": ["peak_force"], "smoothness": 1, "acceleration": 0.6},
        "drive.end_springs": {"stiffness": 5e3, "preload": 200.0, "length": 0.1}, "drive.carts": 2,
        "drive.angles": [0.0, 1.5707963267948966], "drive.turn": "step", "output.items": ["tables"],
    },
}  # fmt: skip
SLOW = {"compaction": pytest.mark.slow, "fem": pytest.mark.slow}


def written(scene, directory, unstable=UNSTABLE, tables="**/*.csv"):
    """Summary without its unstable keys, and columns of the tables that match, by path, as a scene writes them."""
    report.write_study(Study(scene), directory)
    summary, columns = json.loads((directory / "summary.json").read_text(encoding="utf-8")), {}
    for path in sorted(directory.glob(tables)):
        with path.open(newline="", encoding="utf-8") as file:
            header, *rows = csv.reader(file)
        columns[path.relative_to(directory).as_posix()] = {
            name: [read(row[i]) for row in rows] for i, name in enumerate(header)
        }
    return {key: value for key, value in summary.items() if key not in unstable}, columns


def numbers(name, directory):
    """Summary and tables of a scene, without what depends on the machine."""
    summary, tables = written(load_scene(SMALL, **SCENES[name]), directory, tables="*.csv")
    return {"summary": summary, "tables": {table: tables[table] for table in TABLES if table in tables}}


def read(cell):
    """The number in a cell, or its text."""
    try:
        return float(cell)
    except ValueError:
        return cell


def is_estimate(path):
    """True for an error or a residual."""
    return "error" in path or "residual" in path


def different(found, expected, path="", relative=RELATIVE, absolute=ABSOLUTE):
    """Paths at which two nested results differ."""
    if isinstance(expected, dict) and isinstance(found, dict):
        for key in expected.keys() | found.keys():
            yield from different(found.get(key), expected.get(key), f"{path}.{key}", relative, absolute)
    elif isinstance(expected, list) and isinstance(found, list) and len(found) == len(expected):
        for index, pair in enumerate(zip(found, expected, strict=True)):
            yield from different(*pair, f"{path}[{index}]", relative, absolute)
    elif isinstance(expected, float) and isinstance(found, int | float):
        both_nan = math.isnan(found) and math.isnan(expected)
        rounding = ESTIMATE if relative == RELATIVE and is_estimate(path) else relative
        if not both_nan and not math.isclose(found, expected, rel_tol=rounding, abs_tol=absolute):
            yield f"{path}: {found!r}, expected {expected!r}"
    elif found != expected:
        yield f"{path}: {found!r}, expected {expected!r}"


@pytest.mark.parametrize("name", [pytest.param(name, marks=SLOW.get(name, ())) for name in SCENES])
def test_numbers_of_the_scene_are_unchanged(name, tmp_path):
    expected = json.loads((HERE / f"{name}.json").read_text(encoding="utf-8"))
    assert list(different(numbers(name, tmp_path / name), expected)) == []


def main(exact):
    for name in SCENES:
        with tempfile.TemporaryDirectory() as directory:
            found = numbers(name, Path(directory) / name)
        file = HERE / f"{name}.json"
        if exact:
            expected = json.loads(file.read_text(encoding="utf-8"))
            print(name, *(list(different(found, expected, relative=0, absolute=0)) or ["identical"]), sep="\n  ")
        else:
            file.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main("--exact" in sys.argv[1:])
