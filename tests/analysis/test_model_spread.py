"""Spread over the laws of the mix: ratios by columns, laws by which the mix heaps up, and their way to the output."""

import pytest

from compact.analysis.stages.contacts import ContactStage
from compact.analysis.study import Study
from compact.report.text import say
from compact.report.writer import study_summary
from compact.rolling_contact import Heaping, HeapingError
from compact.scene.loader import load_scene

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
