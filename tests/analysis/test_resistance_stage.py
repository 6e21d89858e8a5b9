"""Resistance map of a scene: added mass, unsteady share, and reuse of stored contacts by the next run."""

import json

import numpy as np
import pytest

from compact.analysis.stages import kept_results
from compact.analysis.study import Study
from compact.report import writer as report
from compact.resistance import UNSTEADINESS_LIMIT
from compact.scene.loader import load_scene

ROLLED = {
    "accuracy.engine": "spectral",
    "machine.roller_condition": "frictionless",
    "machine.gap_geometry": "circle",
    "motion.laws": ["cubic", "reversal-3"],
    "output.items": ["tables"],
}


def of_scene(directory=None, **changes):
    return Study(load_scene("small", **ROLLED | changes), directory=directory)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Result directory of a run."""
    directory = tmp_path_factory.mktemp("kept") / "out"
    report.write_study(of_scene(), directory)
    return directory


@pytest.fixture
def left(written, tmp_path):
    """Copy of that directory."""
    copy = tmp_path / "out"
    copy.mkdir()
    for path in (path for path in written.rglob("*") if path.is_file()):
        place = copy / path.relative_to(written)
        place.parent.mkdir(exist_ok=True)
        place.write_bytes(path.read_bytes())
    return copy


def test_unsteady_share_of_a_law_has_its_closed_form(left):
    """cubic: v = 6 s/T z(1-z), a = 6 s/T^2 (1-2z): |a| tau > 0.1 v where 1-2z > (T/tau)/10 z(1-z)."""
    share = json.loads((left / "summary.json").read_text())["laws"]["cubic"]["unsteady_share"]
    rate = UNSTEADINESS_LIMIT * 3.0 / of_scene().stages.contacts.mix.relaxation_time
    first = (2 + rate - np.sqrt(4 + rate**2)) / (2 * rate)  # 1 - 2z = rate z (1 - z)
    assert share == pytest.approx(2 * first, abs=0.02)


@pytest.mark.parametrize(
    "changes",
    [
        {"accuracy.engine": "column"},
        {"mix.overrides.instant_over_relaxed": 1.0},
        {"accuracy.engine": "compaction", "contact.indentation": 0.003},
    ],
    ids=["columns", "elastic", "compaction"],
)
def test_mix_without_relaxation_has_no_added_mass(changes):
    assert of_scene(**changes).stages.contacts.added_mass(0.1) == (0.0, 0.0)


def test_second_run_reuses_every_contact(left, written):
    study = of_scene(left)
    summary = report.write_study(study, left)
    assert study.counts["kept"] == 1
    assert not {"rolled", "resistance", "added mass"} & set(study.counts)
    assert summary["drive_resistance"]["kept"]
    for path in written.rglob("*.csv"):
        assert path.read_bytes() == (left / path.relative_to(written)).read_bytes()
    assert json.loads((written / "summary.json").read_text())["contacts"] == summary["contacts"]


@pytest.mark.parametrize(
    ("changes", "reused"),
    [
        ({"motion.laws": ["septic"], "machine.mass": 900.0, "drive.kind": "crank"}, True),
        ({"mix.moisture": 0.11}, False),
        ({"accuracy.tolerance": 0.02}, False),
        ({"machine.roller_radius": 0.105}, False),
        ({"contact.indentation": 0.003}, False),
    ],
    ids=["laws, cart and drive", "moisture", "tolerance", "radius", "depth"],
)
def test_map_is_reused_after_changes_it_does_not_depend_on(written, changes, reused):
    assert (of_scene(written, **changes).stages.contacts.kept is not None) == reused


def test_faster_law_extends_the_map(written):
    before, study = (
        of_scene(written).stages.contacts.kept.resistance_map,
        of_scene(written, **{"motion.laws": ["septic"]}),
    )
    extended = study.stages.resistance.map
    assert extended.speeds[-1] == pytest.approx(2.1875 * 0.4 / 3, rel=1e-9)  # D: 35/16 of the mean
    assert study.counts["resistance"] <= 2
    assert "rolled" not in study.counts
    assert extended(before.speeds) == pytest.approx(before.forces, rel=1e-12)


@pytest.mark.parametrize("name", [kept_results.MAP_FILE, kept_results.CONTACTS_FILE])
def test_flipped_digit_is_told_and_computed_again(left, caplog, name):
    path = left / name
    content = path.read_bytes()
    at = next(place for place in range(len(content) // 2, len(content)) if content[place : place + 1].isdigit())
    path.write_bytes(content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :])  # another digit
    assert of_scene(left).stages.contacts.kept is None
    assert [record.getMessage().endswith("computed again") for record in caplog.records] == [True]
