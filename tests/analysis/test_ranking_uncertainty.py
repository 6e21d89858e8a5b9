"""Rankings under errors: resolved ranks, ties, spread of the models, engines that end with an error."""

import csv
import json
import math
from types import SimpleNamespace

import numpy as np
import pytest

from compact.analysis.stages.contacts import ContactStage
from compact.analysis.stages.drives import places
from compact.analysis.study import Study
from compact.drive import CRITERIA
from compact.engines.compaction import engine as compaction
from compact.machine.ranking import BUILD_TOLERANCE, Ranked, rank
from compact.report import text
from compact.report import writer as report
from compact.report.text import say
from compact.report.writer import study_summary
from compact.rolling_contact import EquilibriumError, Heaping, HeapingError, Unsteady, UnsteadyError
from compact.scene.loader import load_scene


def run(name, value):
    return SimpleNamespace(name=name, peak_force=value, shocks=())


def order(**values):
    """Places of laws by their peak forces, each with an error of 1 N."""
    runs = {name: run(name, value) for name, value in values.items()}
    heavier = {name: run(name, value + 1) for name, value in values.items()}
    return places(rank(runs.values(), "peak_force"), "peak_force", heavier)


# closed form


def test_error_is_the_change_under_a_greater_resistance():
    ranked = rank([run("a", 10.0), run("b", 12.0)], "peak_force")
    first, last = places(ranked, "peak_force", {"a": run("a", 10.5), "b": run("b", 11.0)})
    assert (first.error, last.error) == (0.5, 1.0)
    assert (first.law, first.rank, first.value, first.margin) == ("a", 1, 10.0, pytest.approx(0.2))


@pytest.mark.parametrize(("second", "resolved"), [(11.9, False), (12.1, True)], ids=["within", "beyond"])
def test_rank_is_resolved_beyond_both_errors(second, resolved):
    assert [place.resolved for place in order(a=10.0, b=second)] == [resolved, True]


@pytest.mark.parametrize(("second", "tie"), [(1009.0, True), (1011.0, False)], ids=["within", "beyond"])
def test_difference_below_the_build_tolerance_is_a_tie_and_not_resolved(second, tie):
    """The error of 1 N in a thousand alone would resolve the two."""
    first, last = order(a=1000.0, b=second)
    assert first.tie == tie
    assert [first.resolved, last.resolved] == [not tie] * 2
    assert not last.tie  # no law is worse


def test_equal_values_share_a_resolved_rank():
    assert [(place.rank, place.resolved) for place in order(a=100.0, b=100.0 * (1 + 1e-12), c=110.0)] == [
        (1, True), (1, True), (3, True),
    ]  # fmt: skip


# hard cases


def test_infinite_values_have_a_reason():
    runs = [Ranked(1, run("a", 10.0), 10.0, math.nan, ""), Ranked(2, run("b", math.inf), math.inf, math.nan, "a jump")]
    first, last = places(runs, "peak_force", {"a": run("a", 11.0), "b": run("b", math.inf)})
    assert (first.resolved, last.resolved, last.error, last.reason) == (True, False, 0.0, "a jump")


# ---- Ties in the results of `compact run`: every criterion under a rigid drive, in tables and page


CONSTANT_VELOCITY = ("constant-velocity", "combined-2", "reversal-2", "reversal-4-free-both")
LAWS = (*CONSTANT_VELOCITY, "cubic", "harmonic", "parabolic", "quintic", "modified-trapezoid")


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Study and directory of a rigid drive ranked by every criterion, by columns with their error estimate."""
    changes = {
        "accuracy.engine": "column", "accuracy.tolerance": 0.05, "contact.speeds": [0.05, 0.3],
        "contact.peak_pressure": 180e3, "layer.fed_density_ratio": 0.95, "drive.kind": "rigid",
        "drive.rank_by": list(CRITERIA), "motion.laws": list(LAWS), "output.items": ["tables"],
    }  # fmt: skip
    study = Study(load_scene("small", **changes))
    directory = tmp_path_factory.mktemp("ties")
    report.write_study(study, directory)
    return study, directory


def rows(directory, by, engine="column"):
    with (directory / "ranking.csv").open(newline="") as stream:
        return [row for row in csv.DictReader(stream) if (row["engine"], row["criterion"]) == (engine, by)]


@pytest.mark.parametrize("by", CRITERIA)
def test_ties_and_infinite_values_are_not_resolved_and_no_margin_is_relative_to_rounding(written, by):
    largest = 1e3 if by == "squared_snap" else 10  # 872056 after 1186 m2/s7: the harmonic law turns as a sine
    for engine in ("column", "formula"):
        found = rows(written[1], by, engine)
        assert not [row for row in found if largest < float(row["margin"]) < math.inf]
        for row in found:
            assert (row["tie"] == "True") == (float(row["margin"]) < BUILD_TOLERANCE)
            assert row["tie"] == "False" or row["resolved"] == "False"
    found = rows(written[1], by)
    infinite = [row for row in found if row["reason"]]
    assert {(row["rank"], row["value"], row["resolved"]) for row in infinite} <= {(str(len(found)), "inf", "False")}
    assert all(row["rank"] != "1" for row in infinite)
    assert infinite or by not in ("peak_jerk", "peak_force", "dynamic_factor", "squared_jerk", "squared_snap")


def test_laws_of_constant_velocity_share_the_first_rank_by_nonuniformity(written):
    first = [row for row in rows(written[1], "nonuniformity") if row["rank"] == "1"]
    assert {row["law"] for row in first} == set(CONSTANT_VELOCITY)
    assert {row["value"] for row in first} == {"0"}


# ---- Spread over the laws of the mix: ratios by columns, laws by which the mix heaps up, and their way to the output


HEAPED = Heaping(0.003, 0.43, 0.0072, 0.54)


def scene(**changes):
    return load_scene("small", **{"accuracy.engine": "column", "output.items": ["model_spread"]} | changes)


def test_laws_of_columns_differ_by_elastic_strain_alone():
    """Both laws satisfy Heckel's curve in confined compression."""
    study = Study(scene())
    spread = study.model_spread
    cohesion = study.stages.contacts.mix.parameter("cohesion_loose")
    assert [each.law for each in spread.variants] == ["drucker-prager-cap"] * 3 + ["ellipse"] * 2
    assert [each.cohesion_loose for each in spread.variants[:3]] == pytest.approx(
        [cohesion.low, cohesion.value, cohesion.high]
    )
    assert [each.saturation_limit for each in spread.variants] == [0.998] * 3 + [0.995, 0.999]
    assert spread.load == pytest.approx((1.0, 1.0), abs=0.02)
    assert spread.resistance == pytest.approx((1.0, 1.0), abs=0.02)


def test_mix_that_heaps_up_by_a_law_is_an_answer(monkeypatch):
    study, case = Study(scene(**{"mix.overrides.saturation_limit": 0.998})), ContactStage.case

    def heaping(contacts, speed):
        if contacts.scene.mix.law == "drucker-prager-cap" and contacts.mix.cohesion_loose < 15e3:
            raise HeapingError("the mix heaps up", HEAPED)
        return case(contacts, speed)

    monkeypatch.setattr(ContactStage, "case", heaping)
    assert [each.heaping for each in study.model_spread.variants] == [HEAPED, HEAPED, None]
    assert "heaps up: drucker-prager-cap at 2.50 kPa (wave 7.20 mm after 0.540 m)" in say("spread", study)
    numbers = study_summary(study, [])["model_spread"]
    assert numbers["variants"][0]["heaping"]["wave_height"] == 0.0072
    assert numbers["variants"][0]["load"] == {"value": None, "unit": "1"}
    assert numbers["load"]["high"] >= 1


@pytest.mark.slow
def test_cohesion_of_loose_mix_halves_the_resistance_of_a_lift():
    """The published lift: with 20 kPa there is almost no bow wave, with the ellipse it is 5.5 mm high."""
    lift = scene(**{"accuracy.engine": "compaction", "layer.lift_thickness": 0.06, "layer.fed_density_ratio": 0.93576})
    lift = lift.replaced(**{"mix.overrides.cohesion_loose": 20e3, "mix.overrides.saturation_limit": 0.998})
    spread = Study(lift).model_spread
    assert len(spread.variants) == 1
    assert spread.load[0] == pytest.approx(0.83, abs=0.03)
    assert spread.resistance[0] == pytest.approx(0.56, abs=0.03)


# ---- Mix that heaps up in front of the roller as an answer: of an engine of the comparison, and of that of the scene


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
