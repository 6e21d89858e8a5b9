"""Engine "column": cost, refused arguments, failures of the integration."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from column_cases import FED, HEIGHT, MIX, SPEED, R, circle, mix, mix_of, random_scenes, rolled
from interrupts import interrupted, of_unix

from compact.engines.column import column_ode
from compact.engines.column.column_ode import LOGARITHMIC, GapShape, PathControl
from compact.engines.column.column_pass import PLATE, Column, column_layer
from compact.engines.column.engine import required_feed, roll, simulate_oedometer
from compact.material.laws import Elastic
from compact.rolling_contact import Layer, Ply, Roller

# cost


def test_evaluations_of_a_pass_are_bounded():
    """2000 evaluations take 0.5 ms."""
    assert rolled().evaluations < 1600


@pytest.mark.parametrize("target", ["load", "peak_pressure", "exit_density_ratio"])
def test_search_for_a_target_takes_few_passes(target):
    spent = []
    for layer, roller, material in random_scenes(40, seed=1):
        contact = roll(layer, roller, material, SPEED)
        value = {target: getattr(contact, target)}
        given = {} if target == "exit_density_ratio" else {"roller": replace(roller, indentation=None, **value)}
        found = roll(layer, given.get("roller", roller), material, SPEED, **({} if given else value))
        assert found.indentation == pytest.approx(contact.indentation, rel=1e-8)
        spent.append(found.evaluations / contact.evaluations)
    assert np.mean(spent) < 10  # passes with their error estimate
    assert max(spent) < 15


# refusals


@pytest.mark.parametrize(
    ("layer", "roller", "material", "speed", "message"),
    [
        (
            Layer(0.22, base="slip"),
            circle(),
            MIX,
            SPEED,
            "the engine column needs a `base` that is bonded, got 'slip': mix",
        ),
        (
            Layer(0.2, plies=(Ply(thickness=0.2, stiffness=2.0),)),
            circle(),
            MIX,
            SPEED,
            "the engine column needs a layer of one mix, got 1 `plies`; use",
        ),
        (
            Layer(0.22),
            circle(),
            Elastic(youngs_modulus=1e7, poisson=0.3),
            SPEED,
            "the engine column needs a `material` Compaction or StateUpdate, got Elastic; use",
        ),
        (Layer(0.22), circle(), MIX, 0.0, "`speed` must not be 0, got 0: the resistance at rest is set-valued"),
        (Layer(0.22), circle(), MIX, np.nan, "`speed` must be finite, got nan"),
        (
            Layer(0.22),
            circle(friction=0.3, rolling="sliding"),
            MIX,
            SPEED,
            "the engine column carries no shear, got `rolling` 'slid",
        ),
        (
            Layer(0.22),
            circle(friction=0.3, rolling="driven"),
            MIX,
            SPEED,
            "`friction` 0.3; use 'free' or the engine co",
        ),
        (Layer(0.22), circle(rolling="skidding"), MIX, SPEED, "no rolling 'skidding'"),
        (Layer(0.22), replace(circle(), profile="cone"), MIX, SPEED, "no profile 'cone'"),
        (
            Layer(0.22),
            circle(0.0132),
            MIX,
            SPEED,
            "`indentation` must be less than 0.0132 m, where grains and water alone",
        ),
        (
            Layer(0.22),
            Roller(R, load=1e6),
            MIX,
            SPEED,
            "`load` must be less than .*, where grains and water alone fill",
        ),
        (Layer(0.22), Roller(R, peak_pressure=1e6), MIX, SPEED, "`peak_pressure` must be less than .*, where grains"),
        (
            Layer(9.0),
            circle(0.2),
            MIX,
            SPEED,
            "`indentation` must be less than 0.11 m, where the circle is buried to its",
        ),
    ],
)
def test_contact_out_of_range_is_refused(layer, roller, material, speed, message):
    with pytest.raises(ValueError, match=message):
        roll(layer, roller, material, speed)


@pytest.mark.parametrize(
    ("demand", "message"),
    [
        (
            lambda: required_feed(HEIGHT, 1.0, MIX, SPEED),
            "`exit_density_ratio` must lie between 0.94, before the pass, and 0.99.*got 1.0",
        ),
        (
            lambda: required_feed(HEIGHT, 0.93, MIX, SPEED),
            "`exit_density_ratio` must lie between 0.94, before the pass, and .*got 0.93",
        ),
        (lambda: required_feed(-1.0, 0.98, MIX, SPEED), "`height` must be positive and finite, got -1.0"),
        (lambda: simulate_oedometer(MIX, -1.0), "`pressure` must be zero or positive, and finite, got .*-1.0"),
        (
            lambda: simulate_oedometer(MIX, [1e5, 1e7]),
            "`pressure` must be less than the stress that closes all pores, got 10000000.0 Pa",
        ),
        (lambda: simulate_oedometer(MIX, 1e5, rate_factor=0), "`rate_factor` must be positive and finite, got 0"),
        (lambda: rolled(strain="engineering"), "no strain 'engineering'; choose from logarithmic, small, mass-true"),
        (
            lambda: rolled(mix(unloading_modulus=1e12)),
            r"`unloading_modulus` must be less than 2.91e\+11 Pa .* got 1000000",
        ),
        (
            lambda: required_feed(HEIGHT, 0.98, mix(unloading_modulus=1e12), SPEED),
            "`unloading_modulus` must be less than",
        ),
        (lambda: simulate_oedometer(mix(unloading_modulus=1e12), 1e5), "`unloading_modulus` must be less than"),
        (lambda: rolled(rtol=0.0), "`rtol` must be positive and finite, got 0.0"),
        (lambda: Column(0.2, 1.0), "`density_ratio` must be below 1, got 1.0"),
        (lambda: Column(0.0, 0.9), "`height` must be positive and finite, got 0.0"),
        (lambda: Column(0.2, 0.9, lateral_stress=np.inf), "`lateral_stress` must be finite, got inf"),
        (
            lambda: rolled(exit_density_ratio=0.93),
            "`exit_density_ratio` must lie between 0.94, before the pass, and 0.99.*got 0.93",
        ),
    ],
)
def test_invalid_argument_is_refused(demand, message):
    with pytest.raises(ValueError, match=message):
        demand()


@pytest.mark.parametrize(
    ("height", "radius", "fed", "load"),
    [(0.5090909090909091, 0.05, 0.77, 5154.639175257732), (1.1247052271667615, 0.032597, 0.77212, 940.8319470976468)],
)
def test_load_beyond_a_buried_circle_is_refused(height, radius, fed, load):
    """The slope of the circle is unbounded at its axis, where steps over x would shrink without limit."""
    material = replace(mix_of(0.1, 0.98, fed), heckel_slope=1.4296351665768224e-05)
    roller = Roller(radius, load=load, friction=0.35, rolling="free", profile="deformed")
    with pytest.raises(ValueError, match=r"`load` must be less than .*, where the circle is buried to its axis, got"):
        roll(Layer(height), roller, material, 0.133)


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
