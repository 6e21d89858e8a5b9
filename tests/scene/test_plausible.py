"""Plausible ranges: a value in other units is advised against or refused, and the user may insist."""

from pathlib import Path

import numpy as np
import pytest

from compact.cli import program as cli
from compact.material import mix
from compact.scene import plausible_ranges
from compact.scene.loader import Scene, SceneError, load_scene
from compact.scene.schema import Overrides

SMALL = Path(__file__).parents[2] / "studies" / "scenes" / "small.toml"


def test_a_pressure_in_kilopascals_is_refused_with_unit_and_remedy():
    with pytest.raises(SceneError) as caught:
        load_scene(SMALL, **{"mix.overrides.required_pressure": 203})
    (mistake,) = caught.value.mistakes
    assert mistake.endswith(
        "mix.overrides.required_pressure: 203 Pa is far outside the plausible 7.33e+03 to 3.5e+06 Pa (the prior over "
        "all moistures and densities, threefold wider); was 203 kPa = 203000 Pa meant? Give the value in Pa; a value "
        'that is meant as it is needs unusual = ["mix.overrides.required_pressure"] at the top of the scene'
    )


@pytest.mark.parametrize(
    ("key", "value", "guess"),
    [
        ("mix.overrides.heckel_slope", 13.0, "was 13 1/MPa = 1.3e-05 1/Pa meant?"),
        ("mix.overrides.unloading_modulus", 120.0, "was 120 MPa = 1.2e+08 Pa meant?"),
        ("mix.overrides.relaxation_time", 100.0, "was 100 ms = 0.1 s meant?"),
        ("mix.overrides.friction_angle", 0.61, "was 0.61 rad = 34.9504 deg meant?"),
        ("mix.overrides.cohesion", 10.0, "was 10 kPa = 10000 Pa meant?"),
        ("product.height", 1e-12, "give the value in m"),
        ("product.height", 1e6, "was 1e+06 um = 1 m meant?"),
        ("product.height", 220.0, "was 220 mm = 0.22 m meant?"),
        ("machine.roller_length", 1164.0, "was 1164 mm = 1.164 m meant?"),
        ("machine.mass", 1.0e9, "give the value in kg"),
        ("machine.mass", 0.5, "was 0.5 t = 500 kg meant?"),
        ("accuracy.tolerance", 1e-30, "give a plain number"),
        ("contact.speeds", [0.1, 1e6], "1e+06 m/s is far outside"),
        ("contact.speeds", [130.0], "was 130 mm/s = 0.13 m/s meant?"),
        ("contact.load", 1e8, "give the value in N"),
        ("contact.peak_pressure", 90.0, "was 90 kPa = 90000 Pa meant?"),
        ("motion.duration", 3000.0, "3000 s is outside"),
        ("layer.passes", 100_000, "must be between 1 and 1000, got 100000"),
    ],
)
def test_values_in_other_units_are_refused_with_a_guess(key, value, guess):
    changes = {key: value} | ({"accuracy.engine": "column"} if key == "layer.passes" else {})
    if key == "motion.duration":  # within ten times the range: the mean speed is refused
        guess = "0.000133333 m/s is outside the plausible 0.001 to 5 m/s"
        assert any(guess in sentence for sentence in load_scene(SMALL, **changes).advice)
        return
    with pytest.raises(SceneError) as caught:
        load_scene(SMALL, **changes)
    assert any(guess in mistake for mistake in caught.value.mistakes), caught.value.mistakes


def test_every_key_of_the_mix_is_checked_against_the_spread_of_the_prior():
    for name in Overrides.model_fields:
        found = plausible_ranges.of_mix(name)
        for moisture, ratio in ((0.08, 0.90), (0.10, 0.98), (0.12, 0.99), (0.093, 0.957)):
            known = mix.prior(moisture, ratio).parameter(name)
            assert found.low < known.low or known.low == 0
            assert known.low <= known.high < found.high


def test_the_range_of_the_mix_is_the_spread_of_the_table_threefold_wider():
    found = plausible_ranges.of_mix("heckel_slope")
    at_rest = 13e-6 * (1 + 0.02 * np.log(201))
    assert found.low == pytest.approx(at_rest * 0.55 / 2.5 / 3, rel=1e-12)
    assert found.high == pytest.approx(at_rest * 1.45 * 2.5 * 3, rel=1e-12)


@pytest.mark.parametrize(("times", "advised", "refused"), [(0.99, 0, 0), (1.01, 1, 0), (9.9, 1, 0), (10.1, 0, 1)])
@pytest.mark.parametrize("key", ["mix.overrides.heckel_slope", "machine.roller_length", "drive.stiffness"])
@pytest.mark.parametrize("side", ["low", "high"])
def test_outside_is_advice_and_ten_times_outside_is_refused(times, advised, refused, key, side):
    found = plausible_ranges.range_of(key)
    value = found.high * times if side == "high" else found.low / times
    assert bool(plausible_ranges.advice(key, value, found)) == bool(advised)
    assert bool(plausible_ranges.refusal(key, value, found)) == bool(refused)
    assert bool(plausible_ranges.refusal(key, -value, found)) == bool(refused)


HYDRAULICS = {
    "piston_area": 1e-3, "supply_pressure": 8e6, "pump_flow": 5e-4, "valve_area": 2e-5, "discharge_coefficient": 0.62,
    "oil_density": 870.0, "transition_drop": 1e3, "dead_volume": 1e-4,
}  # fmt: skip


@pytest.mark.parametrize(("modulus", "told"), [(1.4e9, False), (2e8, False), (1e8, True), (5.5e7, True)])
def test_soft_oil_is_told_beforehand(modulus, told):
    """8 MPa x 3e-4 m3/(2 K 1e-3 m2) of 0.4 m: 3 % at 100 MPa, 1.5 % at 200 MPa."""
    changes = {f"drive.hydraulics.{key}": value for key, value in HYDRAULICS.items()}
    scene = load_scene(SMALL, **changes, **{"drive.kind": "hydraulic", "drive.hydraulics.bulk_modulus": modulus})
    found = [sentence for sentence in scene.advice if "the oil yields by" in sentence]
    assert len(found) == told
    if told:
        assert f"by {8e6 * 3e-4 / (2e-3 * modulus):.3g} m" in found[0]


def test_thousands_of_passes_are_refused_though_meant(tmp_path):
    (tmp_path / "scene.toml").write_text('unusual = ["layer.passes"]\n' + Path(SMALL).read_text())
    columns = {"accuracy.engine": "column", "machine.roller_condition": "frictionless"}
    assert load_scene(tmp_path / "scene.toml", **columns, **{"layer.passes": 1000}).layer.passes == 1000
    with pytest.raises(SceneError, match=r"layer.passes: must be between 1 and 1000, got 130400"):
        load_scene(tmp_path / "scene.toml", **columns, **{"layer.passes": 130400})


def test_advice_names_the_line_of_its_key():
    scene = load_scene(SMALL, **{"mix.overrides.heckel_slope": 2e-4})
    (sentence,) = scene.advice
    assert sentence.endswith(
        "mix.overrides.heckel_slope: 0.0002 1/Pa is outside the plausible 1.05e-06 to 0.000156 1/Pa (the prior over "
        "all moistures and densities, threefold wider); is it in other units?"
    )


def test_a_key_named_unusual_is_neither_refused_nor_advised_against():
    scene = load_scene(SMALL, **{"unusual": ["mix.overrides.heckel_slope"], "mix.overrides.heckel_slope": 13.0})
    assert scene.mix.overrides.heckel_slope == 13.0
    assert scene.advice == ()
    assert scene.replaced(**{"mix.overrides.heckel_slope": 2e-4}).advice == ()


def test_unusual_changes_no_number():
    insisted = load_scene(SMALL, unusual=["product.height"])
    assert insisted.hash == load_scene(SMALL).hash


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("mix.overrides.heckel_slop", r"did you mean 'mix\.overrides\.heckel_slope'\?"),
        ("everything", "give key paths such as"),
        ("mix.moisture", "which is no key with a plausible range"),
    ],
)
def test_unusual_names_keys_that_have_a_range(name, words):
    with pytest.raises(SceneError, match=rf"unusual: holds '{name}', .*{words}|unusual: holds '{name}', {words}"):
        load_scene(SMALL, unusual=[name])


def test_zero_is_no_magnitude():
    none = {"mix.overrides.cohesion": 0.0, "mix.overrides.steel_friction": 0.0, "machine.rolling_arm": 0.0}
    assert load_scene(SMALL, **none).advice == ()


def test_plies_are_checked():
    plies = [{"thickness": 0.2, "relative_modulus": 2.0}, {"thickness": 0.02, "relative_modulus": 1e6}]
    with pytest.raises(
        SceneError, match=r"layer\.plies: relative_modulus 1e\+06 is far outside the plausible 0\.001 to 1000"
    ):
        load_scene(SMALL, **{"accuracy.engine": "fem", "layer.plies": plies})


def test_keys_of_a_compared_engine_are_checked():
    given = {"column": {"mix": {"overrides": {"heckel_slope": 13.0}}}}
    with pytest.raises(SceneError, match=r"compare\.column: with it mix\.overrides\.heckel_slope: 13 1/Pa is far"):
        load_scene(SMALL, compare=given)


def test_a_sweep_refuses_implausible_values_before_it_computes():
    with pytest.raises(SceneError, match=r"mix\.overrides\.heckel_slope: 13 1/Pa is far outside"):
        load_scene(SMALL).require_fields(**{"mix.overrides.heckel_slope": 13.0})


def test_the_speed_of_a_contact_is_checked(tmp_path, capsys):
    assert cli._exit_code(["roll", str(SMALL), "--speed", "1e6", "--out", str(tmp_path / "out")]) == 2
    assert "--speed: 1e+06 m/s is far outside the plausible 0.0001 to 5 m/s" in capsys.readouterr().err


def test_ranges_are_of_keys_of_the_scene():
    for key in plausible_ranges.compared_keys():
        table, found = Scene, None
        for part in key.split("."):
            found = table.model_fields[part]
            table = next(
                (
                    kind
                    for kind in getattr(found.annotation, "__args__", (found.annotation,))
                    if hasattr(kind, "model_fields")
                ),
                None,
            )
        assert found is not None


def test_ranges_are_ordered_and_state_a_reason():
    for key in plausible_ranges.compared_keys():
        if key != "layer.plies":
            found = plausible_ranges.range_of(key)
            assert 0 < found.low < found.high
            assert found.reason
