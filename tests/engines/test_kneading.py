"""Kneading: nine measured gyratory curves, limits of the law, and lifts whose slope grows with their shear work."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from column_cases import mix

from compact.engines.process.kneading import Kneading, Reading, fit_kneading
from compact.engines.process.lifts import GYRATION_WORK, gyrations_of
from compact.engines.process.strokes import confined_stress, confined_work
from compact.scene.plant_data import read_measurements

# Measured on hot asphalt: Jahangiri et al. 2025, github TFHRC-ABML/Pub_TRR_RAmodified_PitC (MIT), commit 768d596,
# Data.xlsx, sheet Compaction Curves; density ratios. The pressure is the standard 600 kPa, not in the file.
CURVES = Path(__file__).parent / "gyratory_curves.csv"
LOOSE = 0.72
READINGS = read_measurements(CURVES).kneading
SPECIMENS = list(dict.fromkeys(each.specimen for each in READINGS))


def of(specimen):
    return [each for each in READINGS if each.specimen == specimen]


def rms(kneading, slope, readings):
    n, p, k = np.array([each[:3] for each in readings]).T
    found = 1 - (1 - LOOSE) * np.exp(-slope * p * kneading.slope_factor(n))
    return float(np.sqrt(np.mean((found - k) ** 2)))


@pytest.mark.parametrize("specimen", SPECIMENS)
def test_every_second_gyration_predicts_the_others(specimen):
    readings = of(specimen)
    found = fit_kneading(readings[::2], LOOSE)
    assert rms(found.kneading, found.static_slopes[specimen], readings[1::2]) <= 0.002
    assert found.kneading.gain == pytest.approx(0.55, abs=0.25)
    assert found.kneading.exponent == pytest.approx(0.7, abs=0.12)


def test_law_of_every_second_specimen_holds_for_the_others():
    """Each of the others has its own static slope, read before the first gyration: the scatter of mixes remains."""
    shared = fit_kneading([each for name in SPECIMENS[::2] for each in of(name)], LOOSE)
    assert shared.rms == pytest.approx(0.0026, abs=2e-4)
    errors = []
    for name in SPECIMENS[1::2]:
        first = of(name)[0]
        slope = np.log((1 - LOOSE) / (1 - first.density_ratio)) / first.pressure
        errors.append(rms(shared.kneading, slope, of(name)))
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(0.0072, abs=3e-4)


def test_density_is_static_without_kneading_and_stays_below_full():
    law = Kneading(gain=0.5, exponent=0.7)
    assert law.slope_factor(0.0) == 1
    rises = 1.5e-6 * 600e3 * law.slope_factor(np.array([0, 1, 10, 100, 1e4]))
    density = 1 - 0.28 * np.exp(-rises)
    assert np.all(np.diff(density) >= 0)
    assert density[-1] <= 1
    assert Kneading(gain=0.0, exponent=0.7).slope_factor(100.0) == 1


def test_fit_finds_the_law_of_its_own_readings():
    law, slope = Kneading(gain=0.4, exponent=0.8), 2e-6
    exact = [Reading(n, 3e5, float(1 - 0.28 * np.exp(-slope * 3e5 * law.slope_factor(n)))) for n in (0, 2, 8, 30)]
    found = fit_kneading(exact, LOOSE)
    assert found.kneading.gain == pytest.approx(0.4, rel=1e-6)
    assert found.kneading.exponent == pytest.approx(0.8, rel=1e-6)
    assert found.static_slopes[""] == pytest.approx(slope, rel=1e-6)
    with pytest.raises(ValueError, match="3 readings are needed, some after gyrations, got 2"):
        fit_kneading(exact[:2], LOOSE)
    with pytest.raises(ValueError, match="`exponent` must be positive"):
        Kneading(gain=0.5, exponent=0.0)


def test_gyrations_are_shear_work_over_pressure():
    material, k = mix(fed_density_ratio=0.75), (0.80, 0.85)
    confined = 0.2 * confined_work(material, [(1.0, k[0])], k[1])
    assert gyrations_of(material, k, 0.2, confined, 1.0) == pytest.approx(0, abs=1e-9)
    turn = 0.2 * GYRATION_WORK * float(confined_stress(material, k[1], 1.0))
    assert gyrations_of(material, k, 0.2, confined + 3 * turn, 1.0) == pytest.approx(3)
    softer = replace(material, heckel_slope=2 * material.heckel_slope)
    assert gyrations_of(softer, k, 0.2, confined + 3 * turn, 1.0) > 6


ROWS = [
    ("cycles,pressure,density_ratio\n0,6e5,0.8\n", None),
    (
        "cycles,pressure,density_ratio\n-1,6e5,0.8\n",
        "kneading 1, `cycles` must be greater than or equal to 0",
    ),
    ("cycles,pressure,density_ratio\n0,6e5,1.0\n", "kneading 1, `density_ratio` must be less than 1, got '1.0'"),
    (
        "cycles,density_ratio\n0,0.9\n",
        "kneading 1 has no `pressure`, got cycles, density_ratio",
    ),
]


@pytest.mark.parametrize(("text", "words"), ROWS)
def test_rows_of_a_plant_are_read_or_refused(text, words, tmp_path):
    path = tmp_path / "rows.csv"
    path.write_text(text)
    if words is None:
        assert read_measurements(path).kneading == (Reading(0.0, 6e5, 0.8),)
        return
    with pytest.raises(ValueError, match=words):
        read_measurements(path)


def test_curves_are_whole():
    with CURVES.open() as lines:
        assert len(list(csv.DictReader(lines))) == len(READINGS) == 9 * 51
