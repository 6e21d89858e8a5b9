"""Share of force and load after a turn (`compact.turning`), against finite elements that move with the mix."""

import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from machine_cases import CART, published_law

from compact import turning
from compact.machine.elastic_drive import ElasticDrive, simulate_elastic
from compact.resistance import dry_resistance

STUDY = Path(__file__).parents[2] / "studies" / "reversal.py"
FORCE, STROKE, DURATION = 3566.0, 0.4, 0.889  # [N], [m], [s]
SIX = "parabolic", "cubic", "quintic", "harmonic", "cycloidal", "reversal-2"
JOIN = 0.08  # [-], contact lengths after the turn from which a history is a table; the release before is exponential


@pytest.fixture(scope="module")
def reversal():
    specification = importlib.util.spec_from_file_location("reversal", STUDY)
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def shallow(reversal):
    """Half the depth of the published lift, which no constant is fitted to."""
    return reversal.history("shallow", 2.0)


def length_of(reversal, name):
    case = reversal.CASES[name]
    return float(np.sqrt(2 * case.radius * case.depth))


@pytest.mark.slow
def test_shares_of_a_case_that_is_held_out_are_met(reversal, shallow):
    """With 6 elements: force 0.014 rms, load 0.048; at most 0.05 and 0.18 in the climb of 2 per contact length."""
    force, load = reversal.residuals(shallow, reversal.told())
    assert np.sqrt(np.mean(force**2)) < 0.02
    assert np.abs(force).max() < 0.08
    assert np.sqrt(np.mean(load**2)) < 0.06
    assert np.abs(load).max() < 0.24


@pytest.fixture(scope="module")
def film(reversal):
    """A make-up of 1 mm and 0.85 on a dense lift, which no constant is fitted to."""
    return reversal.history("denser", 2.0)


@pytest.mark.slow
def test_shares_of_a_make_up_that_is_held_out_are_met(reversal, film):
    """With 6 elements: force 0.029 rms, load 0.030; a layer of the same wave climbs earlier, 0.108 rms."""
    force, load = reversal.residuals(film, reversal.told())
    assert np.sqrt(np.mean(force**2)) < 0.035
    assert np.sqrt(np.mean(load**2)) < 0.04
    film.thickness, thickness = None, film.thickness
    layer, _ = reversal.residuals(film, reversal.told())
    film.thickness = thickness
    assert np.sqrt(np.mean(layer**2)) > 0.09


@pytest.mark.slow
def test_old_force_lets_go_along_the_motion_within_the_release(reversal, shallow):
    share = turning.wave_shares(1.0, 1.0, shallow.wave, shallow.edge)[0]
    assert shallow.force[0] < -0.3
    assert reversal.release(shallow) == pytest.approx(share.release, rel=0.15)


@pytest.mark.slow
def test_old_front_is_met_where_it_was_left(reversal):
    """Return-point memory: the force rises as the mirror of the release, and has its old value from the front on.

    Back by 0.3 contact lengths, forward to 0.015 before the front, back by 0.01 for smaller steps, and forward again.
    """
    front = reversal.STEADY
    found = reversal.run("published", (0, front, front - 0.3, front - 0.015, front - 0.025, front + 0.3), 13 / 3, 6)
    beyond, share = found.x - front, turning.wave_shares(1.0, 1.0, found.wave, 13 / 3)[0]
    track = (found.stroke == 3) & (beyond < -0.05)
    assert np.abs(found.force[track]).max() < 0.03
    last = found.stroke == 5
    loading = last & (beyond < 0)
    expected = share.track + (1 - share.track) * np.exp(beyond[loading] / share.release)
    assert found.force[loading] == pytest.approx(expected, abs=0.08)
    assert found.force[last & (beyond > 0.02)] == pytest.approx(1, abs=0.02)
    assert found.load[last & (beyond > 0.02)] == pytest.approx(1, abs=0.04)


@pytest.mark.slow
@pytest.mark.parametrize(("fixture", "name", "error"), [("shallow", "shallow", 0.06), ("film", "denser", 0.07)])
def test_elastic_drives_see_the_peaks_of_the_history_itself(request, reversal, fixture, name, error):
    """Six laws behind 1 and 3 MN/m: force 3.3 %, power 2.4 %, of the make-up 5.8 %; a step is 70 and 42 % off."""
    found, length, depth = request.getfixturevalue(fixture), length_of(reversal, name), reversal.CASES[name].depth
    thickness = found.thickness and found.thickness * length
    contact = length, depth, found.wave * depth, found.edge * length, thickness
    formula = turning.wave_shares(*contact)
    travel = (found.x + found.edge - 1) * length
    middle, table = (travel[1:] + travel[:-1]) / 2, []  # of neighbouring steps, between which the mesh alternates
    inside = middle > JOIN * length
    for values, share in zip((found.force, found.load), formula, strict=True):
        means = ((values[1:] + values[:-1]) / 2)[inside].clip(0, 1)
        later = np.linspace(middle[-1], STROKE + 0.1, 40)[1:]
        rest = 1 - (1 - share(later)) * (1 - means[-1]) / (1 - share(middle[-1]))  # beyond the run
        places, shares = np.concatenate([[0.0], middle[inside], later]), np.concatenate([means[:1], means, rest])
        release = reversal.release(found) * length
        table.append(turning.table_share(places, shares, track=share.track, distance=share.distance, release=release))
    cart = replace(CART, mass=1000.0)
    for stiffness in (1e6, 3e6):
        drive = ElasticDrive(stiffness, 2 * 0.05 * np.sqrt(stiffness * cart.mass))
        for law in SIX:
            motion = published_law(law, duration=DURATION)
            runs = [
                simulate_elastic(
                    cart, drive, motion, turning.StrokeResistance(dry_resistance(FORCE), force, force, load, load)
                )
                for force, load in (formula, table)
            ]
            assert runs[0].peak_force == pytest.approx(runs[1].peak_force, rel=error)
            assert runs[0].peak_power == pytest.approx(runs[1].peak_power, rel=0.10)
