"""Decision for one law: the rule, sizes with ranges and margins, and what is told of it."""

import json
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from test_verdict import model, study

from compact.analysis.sizing.decision import Size, candidates, choose
from compact.files import json_text
from compact.motion.profile import law
from compact.report import text
from compact.report.explain import explanation
from compact.report.writer import study_summary

CASE, FORCE = (1.0, "rigid"), "peak_force"
CYCLES = {name: law(name, 0.4, 1.0).cycle() for name in ("cubic", "quintic", "septic", "parabolic")}


@cache
def stored():
    return json.loads(json_text(study_summary(study(), [])))


# the rule


def test_candidates_have_the_least_largest_excess_and_named_laws_come_first():
    models = (
        model("formula", cubic=100.0, quintic=105.0, septic=130.0),
        model("column", cubic=120.0, quintic=101.0, septic=100.0),
    )
    laws = {name: CYCLES[name] for name in ("cubic", "quintic", "septic")}
    assert candidates(models, CASE, [FORCE], laws) == ("quintic", "cubic", "septic")
    assert candidates(models, CASE, [FORCE], laws, ["septic"]) == ("septic", "quintic", "cubic")


def test_law_with_the_least_size_is_chosen_and_the_next_is_the_alternative():
    models = [model("formula", cubic=100.0, quintic=105.0)]
    margins = {"cubic": (0.0, 0.5), "quintic": (-0.1, 0.2)}
    source = SimpleNamespace(name="mesh", changes=lambda law, by: margins[law])
    known = SimpleNamespace(sources=(source,))
    found = choose(models, CASE, ("cubic", "quintic"), [FORCE], known)
    assert (found.law, found.alternative, found.excess) == ("quintic", "cubic", 0.0)
    assert choose(models, CASE, ("cubic", "quintic"), [FORCE], None).law == "cubic"
    assert choose(models, CASE, (), [FORCE], None) is None


def test_margin_is_the_root_of_the_sum_of_squares_of_the_increases():
    size = Size("peak", "N", 100.0, {"a": (-0.3, 0.3), "b": (-0.4, 0.4), "c": (-0.1, -0.05)})
    assert size.margin == pytest.approx(0.5)
    assert (size.low, size.high) == pytest.approx((100 * (1 - np.sqrt(0.26)), 150.0))
    assert size.shares == pytest.approx({"b": 0.64, "a": 0.36})
    assert (Size("peak", "N", 100.0).margin, Size("peak", "N", 100.0).low) == (None, None)


# a scene


def test_sizes_are_those_of_the_drive_of_the_scene():
    found, sizing = study().decision, study().machine_sizing
    assert (found.engine, found.invalid) == ("formula", "")
    assert sizing.first_law == found.law
    power, torque = found.sizes["peak_power"], found.sizes["shaft_torque"]
    assert torque.margin == power.margin
    assert torque.value == pytest.approx(power.value * 2 * study().scene.motion.duration / (2 * np.pi), rel=1e-3)
    assert found.sizes["roller_load"].value == pytest.approx(9740, rel=1e-3)
    assert all(size.low < size.value < size.high for key, size in found.sizes.items() if size.changes)


def test_prior_of_the_mix_has_another_resistance_than_the_fit():
    formula = next(each for each in study().models if each.engine == "formula")
    assert formula.prior == pytest.approx((17720.8, 6653.8), rel=1e-4)  # N a roller and a cart, with 0.75 MPa


# what is told


def test_each_number_of_the_first_screen_has_an_explanation():
    heads = [head.replace(" ", "_") for head in text.decision_table(study()).cells()][1:]
    told = ["excess", "drive", "above_first_law", "fitted", "fitted_resistance", "prior_resistance", "feed_ratio",
            "explained_share", "measurements", "not_for_sizing", "peak_jerk"]  # fmt: skip
    for key in (*heads, *told):
        lines = explanation(stored(), key)
        assert lines[0].startswith(f"{key}: ")
        assert lines[1].startswith("from: ")
        assert lines[-1].startswith("theory: docs/")
    size = study().decision.sizes[FORCE]
    words = "\n".join(explanation(stored(), FORCE))
    assert text.say("size", size) in words
    assert "of its square: drive and cart" in words
    assert "fitted: effective_modulus, roller_friction" in words
    assert "published: moisture 0.1" in words
