"""Calibration: what is read, what is fitted, what is told of it, and what is refused."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from compact import cli
from compact.calibrate import blend, calibrate, digest
from compact.engine import compaction
from compact.fitting import fit
from compact.measurements import Band, Measured, Measurement, read
from compact.scene import SceneError, load_scene

SCENES = Path(__file__).parents[1] / "studies" / "scenes"
PUBLISHED = SCENES / "loveikin-2015.toml"
MEASURED = SCENES / "loveikin-2015-measured.toml"


def band(value):
    return Band(value, value, value)


def reading(**stated):
    return Measured((Measurement(**{name: band(value) for name, value in stated.items()}),))


@pytest.fixture(scope="module")
def published():
    return calibrate(load_scene(PUBLISHED), read(MEASURED))


# closed forms


def test_two_powers_are_told_apart():
    found = fit(lambda u: np.exp([u[0] + 0.4 * u[1], u[0] - 0.7 * u[1]]), [6.0, 1.5], [0.0, 0.0])
    exact = np.linalg.solve([[1, 0.4], [1, -0.7]], np.log([6.0, 1.5]))
    assert found.unknowns == pytest.approx(exact, rel=1e-8)
    assert found.sensitivity == pytest.approx(np.linalg.inv([[1, 0.4], [1, -0.7]]), rel=1e-6)


def test_more_data_than_unknowns_leave_the_least_squares():
    found = fit(lambda u: np.exp([u[0]] * 3), [1.0, 2.0, 4.0], [0.0])
    assert np.exp(found.unknowns) == pytest.approx([2.0], rel=1e-8)
    assert found.misfit == pytest.approx(np.log([2.0, 1.0, 0.5]), abs=1e-8)


def test_corrected_cheap_model_meets_the_dear_one():
    def dear(u):
        return np.exp([1.1 * u[0] + 0.5 * u[1] + 0.9, 0.95 * u[0] - 0.6 * u[1] - 0.2 + 0.05 * u[0] ** 2])

    def cheap(u):
        return np.exp([u[0] + 0.4 * u[1], u[0] - 0.7 * u[1]])

    found = fit(cheap, [6.0, 1.5], [0.0, 0.0], dear)
    assert dear(found.unknowns) == pytest.approx([6.0, 1.5], rel=1e-3)
    assert len(found.history) < 7
    again = fit(cheap, [6.0, 1.5], [0.0, 0.0], correction=found.correction)
    assert again.unknowns == pytest.approx(found.unknowns, abs=2e-3)


def test_column_remembers_what_it_was_made_of():
    """compaction.md 2: P 8367.7 N/m, F/P .182854, k .98, h .22 m (E 120 MPa, logarithmic, circle) come from k_in
    .93246, K_H 16.1919/MPa isotropic, M 1.2, pt 14 kPa, h_in 231.279 mm."""
    angle = np.degrees(np.arcsin(1.2 / np.sqrt(3)))
    cohesion = 14e3 * np.tan(np.radians(angle))
    scene = load_scene(PUBLISHED).replaced(
        **{
            "mix.overrides.unloading_modulus": 120e6,
            "mix.overrides.friction_angle": float(angle),
            "mix.overrides.cohesion": float(cohesion),
            "mix.overrides.poisson": 0.3,
            "machine.roller_length": 1.0,
        }
    )
    found = calibrate(scene, reading(load=8367.7, resistance_coefficient=0.182854))
    material = compaction(found.scene, blend(found.scene))
    assert found.fed_density_ratio == pytest.approx(0.93246, abs=1e-5)
    assert material.heckel_slope == pytest.approx(16.1919e-6, rel=1e-5)
    assert found.rolled[0].exit_density_ratio == pytest.approx(0.98, abs=1e-9)
    assert found.rolled[0].exit_height == pytest.approx(0.22, rel=1e-9)


# published numbers


def test_published_machine_is_met_inside_the_prior(published):
    rolled = published.rolled[0]
    assert rolled.load * 1.164 == pytest.approx(9740, rel=1e-6)
    assert rolled.resistance / rolled.load == pytest.approx(0.179, rel=1e-6)
    assert 10.4e-6 < published.heckel_slope < 14.3e-6  # mix.md: what a Heckel column fitted to it needs
    assert 0.93 < published.fed_density_ratio < 0.955


def test_refits_tell_what_stays_uncertain(published):
    refits = {(refit.name, refit.value): refit for refit in published.refits}
    wider = refits["resistance_coefficient", 0.219]
    assert wider.fed_density_ratio == pytest.approx(0.9118, abs=1e-4)
    short, long = refits["machine.roller_length", 0.3], refits["machine.roller_length", 1.2]
    assert short.heckel_slope / long.heckel_slope == pytest.approx(0.3 / 1.2, rel=0.2)  # pressures go as 1/L
    assert not any(refit.reason for refit in published.refits)


def test_sensitivity_is_the_slope_of_the_refit(published):
    scene = load_scene(PUBLISHED)
    more = calibrate(scene, reading(load=9740 * 1.001, resistance_coefficient=0.179))
    slope = np.log(more.heckel_slope / published.heckel_slope) / np.log(1.001)
    density = np.log(more.fed_density_ratio / published.fed_density_ratio) / np.log(1.001)
    assert published.sensitivity[:, 0] == pytest.approx([slope, density], rel=2e-3)


def test_one_datum_fits_one_number():
    found = calibrate(load_scene(PUBLISHED), reading(load=9740.0), unknowns=("heckel_slope",))
    assert found.fed_density_ratio == 0.94
    assert found.rolled[0].load * 1.164 == pytest.approx(9740, rel=1e-8)


# the readings


def test_toml_and_csv_say_the_same(tmp_path):
    toml, csv = tmp_path / "a.toml", tmp_path / "a.csv"
    toml.write_text("[[measurement]]\nload = {value = 9740, low = 9000, high = 10000}\nspeed = 0.2\n")
    csv.write_text("# of one roller\nload,load_low,load_high,speed,resistance\n9740,9000,10000,0.2,\n")
    assert read(toml) == read(csv) == Measured((Measurement(load=Band(9740, 9000, 10000), speed=0.2),))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds no measurement; write one under"),
        ("x = 1", "the file has no key `x`; it takes measurement, assumptions"),
        ("measurement = 3", "`measurement` must be tables"),
        ("[[measurement]]\nlod = 3.0", "measurement 1 has no key `lod`; it takes load, resistance"),
        ("[[measurement]]\nspeed = 3.0", "measurement 1: give at least one of load"),
        ("[[measurement]]\nload = -3.0", "measurement 1, `load` must be a positive number, got -3.0"),
        ("[[measurement]]\nload = nan", "measurement 1, `load` must be a positive number, got nan"),
        ("[[measurement]]\nload = true", "measurement 1, `load` must be a positive number, got True"),
        ("[[measurement]]\nload = {value = 3, low = 4}", "low <= value <= high must hold, got 4, 3, 3"),
        ("[[measurement]]\nload = {low = 4}", "measurement 1, `load` value must be a positive number, got None"),
        (
            "[[measurement]]\nload = 1\nresistance = 1\nresistance_coefficient = 1",
            "or `resistance_coefficient`, not bo",
        ),
        ("[assumptions]\na = 3\n[[measurement]]\nload = 1", r"assumptions, `a` must be \[low, high\], got 3"),
        ("[assumptions]\na = [2, 1]\n[[measurement]]\nload = 1", "assumptions, `a`: low < high must hold, got 2, 1"),
        ("[[measurement]", "Expected"),
    ],
)
def test_readings_are_refused(tmp_path, text, message):
    path = tmp_path / "a.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match=message):
        read(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("load\nx\n", "`load` must be a number, got 'x'"),
        ("load,speed\n3\n", "each row must have one cell for each name"),
        ("load\n", "holds no measurement"),
        ("lod\n3\n", "row 1 has no key `lod`"),
    ],
)
def test_rows_are_refused(tmp_path, text, message):
    path = tmp_path / "a.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=message):
        read(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"a\.toml: cannot be read: No such file"):
        read(tmp_path / "a.toml")


# refusals


def test_more_unknowns_than_data_are_refused():
    with pytest.raises(SceneError, match="2 unknowns cannot be told from 1 data; measure more or fit less"):
        calibrate(load_scene(PUBLISHED), reading(load=9740.0))


def test_data_that_tell_nothing_are_refused():
    with pytest.raises(ValueError, match="the data do not tell the unknowns apart"):
        fit(lambda u: np.exp([u[0] + u[1], u[0] + u[1]]), [6.0, 6.0], [0.0, 0.0])


def test_models_that_never_agree_are_told():
    with pytest.raises(RuntimeError, match="the calibration did not settle in 12 runs"):
        fit(lambda u: np.exp(u), [6.0], [0.0], lambda u: np.exp(2.5 * u))


def test_an_assumption_that_is_no_key_is_refused():
    measured = replace(reading(load=9740.0, resistance_coefficient=0.179), assumptions={"machine.size": (1.0, 2.0)})
    with pytest.raises(SceneError, match=r"machine\.size"):
        calibrate(load_scene(PUBLISHED), measured)


# the command


def test_command_writes_and_tells(tmp_path, monkeypatch, capsys):
    out = tmp_path / "c.json"
    monkeypatch.setattr("sys.argv", ["compact", "calibrate", str(PUBLISHED), str(MEASURED), "--out", str(out)])
    with pytest.raises(SystemExit) as exit_code:
        cli.main()
    assert exit_code.value.code == 0
    written = json.loads(out.read_text())
    assert written["heckel_slope"] == pytest.approx(13.995e-6, rel=1e-4)
    assert "--set layer.fed_density_ratio=0.934439" in capsys.readouterr().out


def test_digest_names_every_bound(published):
    told = digest(published)
    assert all(refit.name in told for refit in published.refits)
