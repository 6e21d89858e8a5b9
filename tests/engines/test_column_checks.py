"""Engine "column": cost, refused arguments, failures of the integration."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from column_cases import FED, MIX, SPEED, R, mix, random_scenes, rolled
from interrupts import interrupted, of_unix

from compact.engines.column import column_ode
from compact.engines.column.column_ode import LOGARITHMIC, GapShape, PathControl
from compact.engines.column.column_pass import PLATE, Column, column_layer
from compact.engines.column.engine import roll

# cost


def test_evaluations_of_a_pass_are_bounded():
    """2000 evaluations take 0.5 ms."""
    assert rolled().own["evaluations"] < 1600


@pytest.mark.parametrize("target", ["load", "peak_pressure", "exit_density_ratio"])
def test_search_for_a_target_takes_few_passes(target):
    spent = []
    for layer, roller, material in random_scenes(40, seed=1):
        contact = roll(layer, roller, material, SPEED)
        value = {target: getattr(contact, target)}
        given = {} if target == "exit_density_ratio" else {"roller": replace(roller, indentation=None, **value)}
        found = roll(layer, given.get("roller", roller), material, SPEED, **({} if given else value))
        assert found.indentation == pytest.approx(contact.indentation, rel=1e-8)
        spent.append(found.own["evaluations"] / contact.own["evaluations"])
    assert np.mean(spent) < 10  # passes with their error estimate
    assert max(spent) < 15


def test_step_underflow_ends_the_integration():
    layer = column_layer((Column(1.0, FED),), MIX, 1.0, GapShape(R, 1.0), LOGARITHMIC)
    with pytest.raises(
        RuntimeError, match=r"the integration of the columns stopped after .* steps .*: shorter steps do not change x"
    ):
        layer.integrate(
            0.01, layer.initial_state + np.nan, PathControl(0.0, np.inf, layer.error_scale(0.01, 1e-9), np.inf)
        )


def test_integration_in_several_calls_agrees(monkeypatch):
    """A keyboard interrupt is raised between two calls."""
    whole, statuses, integrate_path = rolled(rtol=1e-11), [], column_ode.integrate_path

    def recorded(*args):
        statuses.append(integrate_path(*args))
        return statuses[-1]

    monkeypatch.setattr("compact.engines.column.column_pass.STEPS_PER_CALL", 7)
    monkeypatch.setattr(column_ode, "integrate_path", recorded)
    paused = rolled(rtol=1e-11)
    assert statuses.count(column_ode.PAUSED) > 10
    assert (paused.load, paused.resistance) == pytest.approx((whole.load, whole.resistance), rel=1e-10)


LONG = """
import sys
from compact import column
from compact.cli import program as cli
from compact.material import Compaction
from compact.rolling_contact import Roller

def roll(*_, **__):
    "Integrate 400 columns of a stiff mix, some 30 s."
    mix = Compaction(unloading_modulus=2e10, poisson=0.3, heckel_slope=13e-6, loose_density_ratio=0.72,
                     critical_slope=1.2, tensile_strength=14e3, fed_density_ratio=0.94)
    roller = Roller(0.11, indentation=0.009, profile="circle")
    column.roll_over([column.Column(0.22, 0.94)], roller, mix, 0.2)
    print("begun", flush=True)
    return column.roll_over([column.Column(0.22 / 400, 0.94)] * 400, roller, mix, 0.2)

column.roll = roll
sys.argv = ["compact", "roll", {scene!r}, "--engine", "column", "--out", {out!r}]
cli.main()
"""


@of_unix
@pytest.mark.slow
def test_long_integration_is_interruptible(tmp_path):
    scene = str(Path(__file__).parents[2] / "studies/scenes/loveikin-2015.toml")
    code, seconds, message = interrupted(LONG.format(scene=scene, out=str(tmp_path / "out")))
    assert (code, message) == (130, "compact: interrupted; every file already written is whole\n")
    assert seconds < 5  # one second on an idle machine


def test_exhausted_steps_raise_with_the_position():
    """The check of the stiffness is bypassed."""
    stiff = column_layer((Column(1.0, FED),), mix(unloading_modulus=1e13), 1.0, PLATE, LOGARITHMIC)
    with pytest.raises(
        RuntimeError, match=r"the integration of the columns stopped after 40000 steps at x 0\.\d+ m between"
    ):
        stiff.compute_pass(0.05, 1e-9)
