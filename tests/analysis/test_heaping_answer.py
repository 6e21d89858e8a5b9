"""Mix that heaps up in front of the roller as an answer: of an engine of the comparison, and of that of the scene."""

import json

import numpy as np
import pytest

from compact.analysis.study import Study
from compact.engines.compaction import engine as compaction
from compact.report import text
from compact.report import writer as report
from compact.rolling_contact import EquilibriumError, Heaping, HeapingError, Unsteady, UnsteadyError
from compact.scene.loader import load_scene

COMPARED = {"accuracy.engine": "column", "compare": {"compaction": {}}, "output.items": [], "motion.laws": ["cubic"]}


def test_an_engine_of_the_comparison_that_heaps_up_is_an_answer(tmp_path):
    case = Study(load_scene("small", **COMPARED))
    summary = report.write_study(case, tmp_path / "out")
    stored = json.loads((tmp_path / "out" / "summary.json").read_text())["heaping"]["compaction"]
    assert stored["depth"] == {"value": pytest.approx(9.37e-3, rel=1e-2), "unit": "m"}
    assert stored["contact_angle"] == {"value": pytest.approx(np.pi / 4), "unit": "rad"}
    assert (stored["travel"]["value"], stored["is_estimate"]) == (None, True)
    assert "in lifts (`layer.lift_thickness`)" in stored["reason"]
    assert list(summary["comparison"]) == ["formula"]
    assert summary["steady_forces"]["resistance"]["value"] > 3e3  # of the columns, which lead
    digest = " ".join(text.study_digest(case).split())
    assert "compaction: the mix heaps up in front of the roller, no steady state at a depth of 9.37 mm;" in digest


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("error", "key", "numbers", "words"),
    [
        (HeapingError("the wave grows", Heaping(0.0052, 0.71, 0.0213, 0.314)), "heaping", {"travel": 0.314},
         "after 0.314 m of travel the bow wave is 21.3 mm high, a contact angle of 40.7°"),
        (UnsteadyError("not steady", Unsteady(0.0052, 0.0213, 0.9, 0.24, 5e3, 900.0)), "unsteady",
         {"distance": 0.24, "travel": 0.9}, "not steady at a depth of 5.20 mm after 0.900 m of travel, estimated"),
        (EquilibriumError("no equilibrium, residual 0.3 of the nodal forces"), "no_equilibrium", {},
         "compaction: no equilibrium, so that it has no resistance"),
    ],
)  # fmt: skip
def test_an_engine_of_the_comparison_that_ends_with_an_error_is_an_answer(
    tmp_path, monkeypatch, error, key, numbers, words
):
    def fail(*_, **__):
        raise error

    monkeypatch.setattr(compaction, "roll", fail)
    case = Study(load_scene("small", **COMPARED))
    summary = report.write_study(case, tmp_path / "out")
    assert list(summary["comparison"]) == ["formula"]
    stored = {each: summary[each] for each in ("heaping", "unsteady", "no_equilibrium")}
    assert [each for each, found in stored.items() if found] == [key]
    assert str(error) in stored[key]["compaction"]["reason"]
    assert {name: stored[key]["compaction"][name]["value"] for name in numbers} == numbers
    assert words in " ".join(text.study_digest(case).split())
    assert text.model_table(case)["model"][-1] == "compaction"
