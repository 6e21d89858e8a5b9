"""Prescribed quantities: every engine reaches them or raises, and never returns another contact."""

import re
from dataclasses import replace

import numpy as np
import pytest

from compact import fem
from compact.analysis.engines import ENGINES
from compact.analysis.multipass import Pass, passes
from compact.engines import formula
from compact.engines.column import engine as column
from compact.engines.fem import contact_problem
from compact.engines.spectral import engine as spectral
from compact.material.laws import Compaction, Elastic, Viscoelastic
from compact.rolling_contact import Layer, Roller, require_on_target, require_target_reached

R, SPEED = 0.11, 0.2
MIX = Compaction(
    unloading_modulus=120e6,
    poisson=0.3,
    heckel_slope=13e-6,
    loose_density_ratio=0.72,
    critical_slope=1.2,
    tensile_strength=14e3,
    fed_density_ratio=0.94,
)
LINEAR = Viscoelastic(youngs_modulus=10e6, poisson=0.3, branches=((1.0, 0.1),))
LAYER, THIN = Layer(0.22), Layer(0.06)
TOLERANCES = {"formula": 1e-9, "column": 1e-8, "spectral": 1e-9, "fem": 1e-8, "compaction": 1e-3}
MATERIALS = {
    "formula": Elastic(youngs_modulus=10e6, poisson=0.3),
    "column": MIX,
    "spectral": LINEAR,
    "fem": LINEAR,
    "compaction": MIX,
}
REFUSALS = (
    "must be less than|must lie between|is undefined on a half-plane|is wider than the circle|beyond its edge|"
    "too narrow|"
    r"does not touch|is buried|would press mix|takes? up|not met down to|not met in \d+ depths|not reached|heaps up|"
    "still not held|"
    "join that ply|no capture angle|no contact|half-width not found|reach a relative error|would be below the mix|"
    "`[a-z_]+` but"
)
VALUES = {  # from nearly nothing to beyond the bearing capacity of any layer
    "indentation": (1e-6, 1e-4, 3e-3, 0.0131, 0.0132, 0.109, 0.3),
    "load": (1e-2, 10.0, 8e3, 1.3e4, 1.4e4, 1e6, 1e12),
    "peak_pressure": (1.0, 1e4, 203e3, 3.1e5, 3.3e5, 1e8, 1e12),
    "exit_density_ratio": (0.93, 0.94 + 1e-9, 0.95, 0.98, 0.9999, 1.0),
}


def _is_slow(engine, target, value):
    """Contacts that are tiny or unbounded, which the engines of a linear layer find in many iterations."""
    unbounded = (target, value) in (("load", 1e12), ("peak_pressure", 1e12), ("peak_pressure", 1e8))
    tiny = (target, value) in (("load", 1e-2), ("peak_pressure", 1.0), ("indentation", 1e-6))
    return (engine == "spectral" and unbounded) or (engine == "fem" and (unbounded or tiny))


CASES = [
    pytest.param(
        engine,
        target,
        value,
        profile,
        id=f"{engine}-{target}-{value:g}-{profile}",
        marks=[pytest.mark.slow] if _is_slow(engine, target, value) else [],
    )
    for engine in ("formula", "column", "spectral", "fem")
    for target, values in VALUES.items()
    for value in values
    for profile in (("parabola",) if engine == "formula" else ("parabola", "circle"))
    if ENGINES[engine].compacting or target != "exit_density_ratio"
]


def rolled(engine, target, value, profile="parabola", layer=LAYER, **options):
    given = {"indentation": 1e-3} if target == "exit_density_ratio" else {target: value}
    options |= {target: value} if target == "exit_density_ratio" else {}
    engine_options = {"estimate": False} if engine == "fem" else {}
    roller = Roller(R, **given, profile=profile)
    roll = ENGINES[engine].roll
    return roll(layer, roller, MATERIALS[engine], SPEED, **options, **engine_options)


@pytest.mark.sampled(16)
@pytest.mark.filterwarnings("ignore:half-plane theory")
@pytest.mark.parametrize(("engine", "target", "value", "profile"), CASES)
def test_target_is_reached_or_refused(engine, target, value, profile):
    try:
        found = rolled(engine, target, value, profile)
    except (ValueError, RuntimeError) as error:
        refusal = str(error)
    else:
        refusal = None
        assert getattr(found, target) == pytest.approx(value, rel=TOLERANCES[engine])
    assert refusal is None or re.search(REFUSALS, refusal)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("target", "value"),
    [
        ("indentation", 1e-3),
        ("indentation", 0.05),
        ("load", 4000.0),
        ("peak_pressure", 340e3),
        ("exit_density_ratio", 0.955),
        ("exit_density_ratio", 0.93),
    ],
)
def test_target_of_compaction_is_reached_or_refused(target, value):
    try:
        found = rolled("compaction", target, value, "circle", THIN, increments=4)
    except (ValueError, RuntimeError) as error:
        refusal = str(error)
    else:
        refusal = None
        assert getattr(found, target) == pytest.approx(value, rel=TOLERANCES["compaction"])
    assert refusal is None or re.search(REFUSALS, refusal)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("torque", [-30.0, 0.0, 55.0, 1e3])
@pytest.mark.parametrize("speed", [0.2, -0.2])
def test_torque_is_reached_or_refused(torque, speed):
    """The moment of the shear about the axle is the torque; beyond the friction limit the roller skids."""
    roller = Roller(R, indentation=3e-3, friction=0.3, rolling="driven")
    if torque > 100:
        with pytest.raises(RuntimeError, match="the roller skids"):
            fem.roll(LAYER, roller, LINEAR, speed, torque=torque, estimate=False)
        return
    found = fem.roll(LAYER, roller, LINEAR, speed, torque=torque, estimate=False)
    moment = -np.sign(speed) * R * np.trapezoid(found.shear_traction, found.x)
    assert moment == pytest.approx(torque, abs=5e-3 * 0.3 * found.load * R)


# every engine checks its contact against the target


def off(value):
    return 1.001 * value


def test_formula_off_target_raises(monkeypatch):
    inverse = formula.pressure_for_load
    monkeypatch.setattr(formula, "pressure_for_load", lambda load, *rest: inverse(off(load), *rest))
    with pytest.raises(
        RuntimeError, match=r"`load` 8000 was prescribed and 8008 reached: relative error 1\.0e-03, tolerance 1e-09"
    ):
        rolled("formula", "load", 8e3)


@pytest.mark.parametrize("target", ["indentation", "load", "peak_pressure", "exit_density_ratio"])
def test_columns_off_target_raise(monkeypatch, target):
    value = {"indentation": 3e-3, "load": 8e3, "peak_pressure": 2e5, "exit_density_ratio": 0.96}[target]
    find = column.solve_target
    monkeypatch.setattr(column, "solve_target", lambda there, name, wanted, rtol: find(there, name, off(wanted), rtol))
    with pytest.raises(
        RuntimeError, match=f"`{target}` {value:.9g} was prescribed and .* tolerance 1e-08; the contact"
    ):
        rolled("column", target, value)


def test_feed_off_target_raises(monkeypatch):
    find = column.solve_target
    monkeypatch.setattr(column, "solve_target", lambda there, name, wanted, rtol: find(there, name, off(wanted), rtol))
    with pytest.raises(RuntimeError, match=r"`exit_density_ratio` 0\.96 was prescribed and 0\.96096 reached"):
        column.required_feed(0.22, 0.96, MIX, SPEED)


def test_passes_off_target_raise(monkeypatch):
    find = column.solve_target
    monkeypatch.setattr(column, "solve_target", lambda there, name, _, rtol: find(there, name, 8e3, rtol))
    roller = Roller(R, load=8e3)
    with pytest.raises(RuntimeError, match="`load` 9000 was prescribed and 8000 reached"):
        passes(LAYER, roller, MIX, SPEED, (Pass(), Pass(load=9e3, forward=False)))


@pytest.mark.parametrize("target", ["indentation", "load", "peak_pressure"])
def test_spectral_off_target_raises(monkeypatch, target):
    value = {"indentation": 3e-3, "load": 8e3, "peak_pressure": 2e5}[target]
    build_rolling_problem = spectral.build_rolling_problem

    def missed(*given):
        problem, half_width = build_rolling_problem(*given)
        return replace(problem, value=off(problem.value)), half_width

    monkeypatch.setattr(spectral, "build_rolling_problem", missed)
    with pytest.raises(
        RuntimeError, match=f"`{target}` {value:.9g} was prescribed and .* tolerance 1e-09; the contact"
    ):
        rolled("spectral", target, value)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("target", ["indentation", "load", "peak_pressure"])
def test_finite_elements_off_target_raise(monkeypatch, target):
    value = {"indentation": 3e-3, "load": 8e3, "peak_pressure": 2e5}[target]
    at_target = contact_problem.solve_at_target

    def missed(case, *given, **options):
        return at_target(replace(case, roller=replace(case.roller, **{target: off(value)})), *given, **options)

    monkeypatch.setattr(contact_problem, "solve_at_target", missed)
    with pytest.raises(
        RuntimeError, match=f"`{target}` {value:.9g} was prescribed and .* tolerance 1e-08; the contact"
    ):
        rolled("fem", target, value)


def test_torque_off_target_raises():
    found = fem.roll(LAYER, Roller(R, indentation=3e-3), LINEAR, SPEED, estimate=False)
    roller = Roller(R, indentation=found.indentation, friction=0.3, rolling="free")
    require_on_target(found, roller, 1e-8, torque=(0.0, 0.0))
    with pytest.raises(RuntimeError, match=r"`torque` 0 was prescribed and 0.1 reached: .* tolerance 1e-08"):
        require_on_target(found, roller, 1e-8, torque=(0.0, 0.1))


def test_not_a_number_is_off_target():
    with pytest.raises(RuntimeError, match="`load` 1 was prescribed and nan reached"):
        require_target_reached("load", 1.0, np.nan, 1e-3)
