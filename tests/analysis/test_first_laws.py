"""First laws over drive, fresh mix behind the roller and model, against the simulations of the drives."""

import json
import re
from functools import cache
from pathlib import Path

import pytest

from compact.analysis.stages.first_laws import OWN_TRACK, RIGID, SCENE_DRIVE, STEP, first_laws
from compact.analysis.study import Study
from compact.report import text
from compact.report import writer as report
from compact.scene.loader import load_scene

ENGINES = Path(__file__).parents[2] / "compact" / "data" / "scenes" / "loveikin-2015-engines.toml"
FORMULA = {
    "accuracy.engine": "formula", "compare": None, "motion.other_durations": None, "output.items": ["report"],
    "motion.laws": ["parabolic", "cubic", "harmonic", "crank", "constant-velocity"],
}  # fmt: skip
D = "machine.sleeve_distance"


def found(**changes):
    """Study and first laws of the scene with changes, each computed once."""
    return _found(json.dumps(changes))


@cache
def _found(changes):
    case = Study(load_scene(ENGINES, **FORMULA | json.loads(changes)))
    return case, first_laws(case.scene, case.models, case.stages.laws.cycles)


@pytest.mark.parametrize(
    ("turn", "changes"),
    [
        ("110 mm", {}),
        ("180 mm, midway sleeve", {D: 0.18}),
        (STEP, {"drive.turn": "step"}),
    ],
)
def test_peaks_are_those_of_the_drives(turn, changes):
    case = next(each for each in found()[1].cases if each.turn == turn)
    stage = found(**changes)[0].stages.drive
    for by, quantity in (("peak_force", "peak_force"), ("peak_power", "peak_power")):
        for law, run in stage.runs.items():
            if law not in ("crank", "constant-velocity"):
                assert case.peaks[by][SCENE_DRIVE][law] == pytest.approx(getattr(run, quantity), rel=2e-3)
            assert case.peaks[by][RIGID][law] == pytest.approx(getattr(run.rigid, quantity), rel=2e-3)
    assert not {"crank", "constant-velocity"} & case.peaks["peak_force"][SCENE_DRIVE].keys()


def test_cases_cover_the_range_of_the_drive_and_the_distance():
    known = found()[1]
    assert [each.turn for each in known.cases] == [
        OWN_TRACK, "26.4 mm, open sleeve", "110 mm", "180 mm, midway sleeve", STEP,
    ]  # fmt: skip
    assert known.drives[:4] == (RIGID, SCENE_DRIVE, "stiffness ÷ 3", "stiffness ÷ 1.73")
    assert len(known.drives) == 16
    assert known.number == 80
    assert sum(known.firsts("peak_force").values()) == 80


def test_least_excess_is_that_of_every_case_by_hand():
    _, known = found()
    worst = {
        law: max(
            peaks[law] / min(peaks.values()) for each in known.cases for peaks in each.peaks["peak_power"].values()
        )
        for law in ("parabolic", "cubic", "harmonic")
    }
    law, excess = known.least_excess["peak_power"]
    assert (law, 1 + excess) == (min(worst, key=worst.get), pytest.approx(min(worst.values())))


def test_linear_engine_and_a_scene_with_a_step_have_the_step_alone():
    assert [each.turn for each in found(**{"drive.turn": "step"})[1].cases] == [STEP]


@pytest.mark.parametrize("changes", [{"motion.dwell": 0.1}, {"motion.laws": ["crank"]}])
def test_drives_without_a_model_are_left_out(changes):
    assert found(**changes)[1].drives == (RIGID,)


def test_page_terminal_and_summary_state_them():
    case, known = found()
    vars(case)["first_laws"] = known  # which a study computes after its uncertainty
    words = text.say("first_laws", case)
    assert words.startswith("in all 80 cases of drive, fresh mix and valid model: ")
    assert "more force than the first law" in words
    assert "; a step, as of no mix, would give parabolic 10.2 kN and cubic" in text.say("turn", case)
    cells = text.first_laws_table(case).cells()
    assert cells["fresh mix from the axle"][0] == OWN_TRACK
    assert cells["force, rigid"][-1] == "parabolic 5.59 kN"
    assert sum(map(int, re.findall(r"\((\d+)\)", cells["force, 15 springs"][-1]))) == 15
    stored = json.loads(json.dumps(report._first_laws(known)))
    assert stored["cases"][2]["first"]["peak_force"][1]["drive"] == SCENE_DRIVE
