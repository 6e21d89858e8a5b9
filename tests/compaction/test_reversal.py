"""Share of force and load after a turn (`compact.turning`), against finite elements that move with the mix."""

import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from compact import turning

STUDY = Path(__file__).parents[2] / "studies" / "reversal.py"


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
    """With 6 elements: force 0.029 rms, load 0.034; a layer of the same wave climbs earlier, 0.098 rms."""
    force, load = reversal.residuals(film, reversal.told())
    assert np.sqrt(np.mean(force**2)) < 0.035
    assert np.sqrt(np.mean(load**2)) < 0.04
    film.thickness, thickness = None, film.thickness
    layer, _ = reversal.residuals(film, reversal.told())
    film.thickness = thickness
    assert np.sqrt(np.mean(layer**2)) > 0.09


@pytest.mark.slow
@pytest.mark.parametrize("fixture", ["shallow", "film"])
def test_old_force_lets_go_along_the_motion_within_the_elastic_release(request, reversal, fixture):
    """Both are held out: r/a is 0.0104 and 0.0364, by the formula 0.0120 and 0.0409."""
    found = request.getfixturevalue(fixture)
    assert found.force[0] < -0.3
    assert reversal.release(found) == pytest.approx(found.release, rel=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("modulus", [60e6, 240e6])
def test_release_of_a_mix_of_another_modulus_is_predicted(monkeypatch, reversal, modulus):
    """The constants are of 120 MPa. On a layer of 20 mm r/a is 0.0241 and 0.0058, by formula 0.0229 and 0.0059."""
    monkeypatch.setattr(reversal, "MIX", replace(reversal.MIX, unloading_modulus=modulus))
    monkeypatch.setattr(reversal, "steady", reversal.steady.__wrapped__)
    monkeypatch.setitem(reversal.CASES, "thin layer", replace(reversal.CASES["thin layer"], extent=-0.7))
    found = reversal.history("thin layer", 2.0)  # up to 0.3 contact lengths after the turn
    assert reversal.release(found) == pytest.approx(found.release, rel=0.08)


@pytest.mark.slow
def test_old_front_is_met_where_it_was_left(reversal):
    """Return-point memory: the force rises as the mirror of the release, and has its old value from the front on.

    Back by 0.3 contact lengths, forward to 0.015 before the front, back by 0.01 for smaller steps, and forward again.
    """
    front = reversal.STEADY
    found = reversal.run("published", (0, front, front - 0.3, front - 0.015, front - 0.025, front + 0.3), 13 / 3, 6)
    beyond, share = found.x - front, turning.wave_shares(1.0, 1.0, found.wave, found.release, 13 / 3)[0]
    track = (found.stroke == 3) & (beyond < -0.05)
    assert np.abs(found.force[track]).max() < 0.03
    last = found.stroke == 5
    loading = last & (beyond < 0)
    expected = share.track + (1 - share.track) * np.exp(beyond[loading] / share.release)
    assert found.force[loading] == pytest.approx(expected, abs=0.08)
    assert found.force[last & (beyond > 0.02)] == pytest.approx(1, abs=0.02)
    assert found.load[last & (beyond > 0.02)] == pytest.approx(1, abs=0.04)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["shallow", "denser"])
def test_elastic_drives_see_the_peaks_of_the_history_itself(request, reversal, name):
    """Six laws behind 1 and 3 MN/m: force 3.5 %, power 2.6 %; a step is 71 and 36 % off at least."""
    found = request.getfixturevalue({"shallow": "shallow", "denser": "film"}[name])
    formula, step, history = reversal.drive_peaks(name, found)
    force, power = np.abs(formula / history - 1).max(axis=1)
    assert max(force, power) < 0.06
    force, power = np.abs(step / history - 1).max(axis=1)
    assert force > 0.6
    assert power > 0.3
