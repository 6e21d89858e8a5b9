"""Resistance map of a scene: added mass, unsteady share, and reuse of stored contacts by the next run."""

from pathlib import Path

import pytest

from compact import files
from compact.analysis.stages import kept_results
from compact.analysis.study import Study
from compact.files import ResultsError
from compact.report import writer as report
from compact.scene.loader import load_scene

SMALL = Path(__file__).parents[2] / "compact" / "data" / "scenes" / "small.toml"

ROLLED = {
    "accuracy.engine": "spectral",
    "machine.roller_condition": "frictionless",
    "machine.gap_geometry": "circle",
    "motion.laws": ["cubic", "reversal-3"],
    "output.items": ["tables"],
}


def of_scene(directory=None, **changes):
    return Study(load_scene(SMALL, **ROLLED | changes), directory=directory)


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


def test_added_mass_of_a_cart_is_that_of_all_its_rollers():
    study = of_scene()
    resistance, machine = study.stages.resistance.resistance, study.scene.machine
    mass, time = study.stages.contacts.added_mass(float(resistance.speeds[-1]))
    assert resistance.added_masses[-1] == pytest.approx(machine.rollers * machine.roller_length * mass, rel=1e-12)
    assert resistance.relaxation_time == time == pytest.approx(study.stages.contacts.mix.relaxation_time)


@pytest.mark.parametrize("name", [kept_results.MAP_FILE, kept_results.CONTACTS_FILE])
@pytest.mark.parametrize("content", [b"", b"{}", None], ids=["empty", "other", "gone"])
def test_damaged_files_are_not_reused(left, name, content):
    (left / name).unlink() if content is None else (left / name).write_bytes(content)
    assert of_scene(left).stages.contacts.kept is None


def test_results_of_an_edited_program_are_computed_again(left, caplog, monkeypatch):
    assert of_scene(left).stages.contacts.kept
    other = files.versions() | {"source": "edited"}
    monkeypatch.setattr(files, "versions", lambda: other)
    assert of_scene(left).stages.contacts.kept is None
    assert [record.getMessage() for record in caplog.records] == [
        f"{left / 'contacts.json'}: of another program, table or input; its contacts are computed again"
    ]


def test_results_of_another_scene_are_not_overwritten(left):
    with pytest.raises(ResultsError, match="holds results of another scene"):
        report.write_study(of_scene(left, **{"machine.mass": 900.0}), left)
