"""Resistance at first order in the acceleration by finite elements: tables, the engine "spectral", a transient."""

from dataclasses import replace

import numpy as np
import pytest

from compact import mesh
from compact.analysis.engines import expand_resistance as spectral_expansion
from compact.engines.fem import compliance, contact_problem
from compact.engines.fem import engine as fem_engine
from compact.engines.fem.compliance import NodalField
from compact.engines.fem.convected_memory import creep_function, retardation_operator
from compact.engines.fem.speed_derivative import expand_resistance
from compact.material.laws import Elastic, Viscoelastic
from compact.resistance import UNSTEADINESS_LIMIT
from compact.rolling_contact import Layer, Ply, Roller

R = 0.11
BONDED, SLIP = Layer(0.22), Layer(0.22, base="slip")
PLIES = Layer(0.22, plies=(Ply(thickness=0.17, stiffness=1.0), Ply(thickness=0.05, stiffness=3.0)))
MIX = Viscoelastic(youngs_modulus=10e6, poisson=0.3, branches=((1.0, 0.05),))  # table e2 of contact.md
THREE = Viscoelastic(youngs_modulus=10e6, poisson=0.3, branches=((0.5, 0.02), (1.0, 0.1), (0.3, 1.0)))
COARSE = mesh.mesh_for_error(0.22, 0.026, 2e-3)


def roller_at(indentation=0.006, **other):
    """Roller at an indentation [m]."""
    return Roller(R, indentation=indentation, **other)


def scale(found):
    """Reference of relative errors of M, which passes zero."""
    return max(abs(found.added_mass), found.relaxation_time * abs(found.slope))


# closed forms and published numbers


def test_elastic_layer_has_no_added_mass():
    found = expand_resistance(
        BONDED, roller_at(friction=0.3, rolling="sliding"), Elastic(youngs_modulus=10e6, poisson=0.3), 0.3
    )
    assert (found.slope, found.added_mass, found.error, found.relaxation_time) == (0.0, 0.0, 0.0, 0.0)
    assert found.resistance > 0


@pytest.mark.slow
def test_lag_on_a_deformed_surface_grows_with_the_indentation():
    def lag(indentation, profile):
        found = expand_resistance(BONDED, roller_at(indentation, profile=profile), MIX, 1e-3, estimate=False)
        return -found.added_mass / found.slope

    depths = np.array([0.0015, 0.003, 0.006])
    growth = np.array([lag(depth, "deformed") / lag(depth, "parabola") - 1 for depth in depths])
    assert growth == pytest.approx(depths / R, rel=0.2)
    assert np.polyfit(np.log(depths), np.log(growth), 1)[0] == pytest.approx(1, abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("speed", "resistance", "slope", "mass"),
    [  # contact.md e2: v [m/s], F/E*, F'/E*, M/E*
        pytest.param(0.05, 5.86129e-5, 9.4278e-4, -3.904e-5, marks=pytest.mark.slow),
        (0.2, 1.29245e-4, 1.6930e-4, 1.764e-6),
        pytest.param(1.0, 1.21647e-4, -3.5182e-5, 1.213e-6, marks=pytest.mark.slow),
    ],
)
def test_layer_of_table_e2(speed, resistance, slope, mass):
    found = expand_resistance(BONDED, roller_at(), MIX, speed, estimate=False)
    assert found.resistance / MIX.contact_modulus == pytest.approx(resistance, rel=4e-4)
    assert found.slope / MIX.contact_modulus == pytest.approx(slope, rel=5e-3)
    assert found.added_mass / MIX.contact_modulus == pytest.approx(mass, rel=5e-3)


def test_thin_layer_on_a_frictionless_base_is_the_winkler_foundation_of_table_e():
    """contact.md e at De = 1: F R^2/(kr b^4) and M R^2/(kr b^3 tau^2)."""
    radius, height, mix = 100.0, 0.1, Viscoelastic(youngs_modulus=0.91, poisson=0.3, branches=((1.0, 1.0),))
    found = expand_resistance(
        Layer(height, base="slip"), Roller(radius, indentation=0.5 / radius), mix, 1.0, estimate=False
    )
    units = radius**2 * height
    assert (found.resistance * units, found.added_mass * units) == pytest.approx((0.10445711, 0.030866), rel=0.01)


# the engine "spectral"

DEEP = Roller(R, load=1e4)
CASES = {
    "slip": (SLIP, roller_at(), MIX, 0.3),
    "plies": (PLIES, roller_at(), MIX, 0.3),
    "sliding circle on slip": (SLIP, roller_at(profile="circle", friction=0.4, rolling="sliding"), MIX, 0.05),
    "sliding backwards": (SLIP, roller_at(friction=0.4, rolling="sliding"), MIX, -0.3),
    "three branches": (SLIP, roller_at(), THREE, 0.3),
    "load": (SLIP, DEEP, MIX, 0.3),
    "peak pressure": (SLIP, Roller(R, peak_pressure=2e5), MIX, 0.05),
}
SLOW_CASES = ("slip", "sliding circle on slip", "sliding backwards", "three branches", "load", "peak pressure")


@pytest.mark.parametrize(
    "case",
    [pytest.param(case, id=name, marks=[pytest.mark.slow] * (name in SLOW_CASES)) for name, case in CASES.items()],
)
def test_agreement_with_the_spectral_engine(case):
    exact, found = spectral_expansion(*case), expand_resistance(*case, estimate=False)
    assert found.resistance == pytest.approx(exact.resistance, rel=1e-3)
    assert found.slope == pytest.approx(exact.slope, abs=2e-3 * abs(exact.resistance / exact.speed))
    assert found.added_mass == pytest.approx(exact.added_mass, abs=0.01 * scale(exact))


@pytest.mark.slow
@pytest.mark.parametrize(("ratio", "speed"), [(5.0, 0.3), pytest.param(20.0, 0.01, marks=pytest.mark.slow)])
def test_slope_and_added_mass_of_stiff_branches_are_within_half_a_percent(ratio, speed):
    mix = Viscoelastic(youngs_modulus=10e6, poisson=0.3, branches=((ratio - 1, 0.05),))
    exact = spectral_expansion(BONDED, roller_at(), mix, speed)
    found = expand_resistance(BONDED, roller_at(), mix, speed, estimate=False)
    assert found.slope == pytest.approx(exact.slope, rel=5e-3)
    assert found.added_mass == pytest.approx(exact.added_mass, rel=5e-3)


@pytest.mark.slow
def test_error_estimate_covers_the_true_error():
    exact, found = (
        spectral_expansion(SLIP, roller_at(), MIX, 0.3),
        expand_resistance(SLIP, roller_at(), MIX, 0.3, mesh=COARSE),
    )
    assert abs(found.added_mass - exact.added_mass) <= found.error < 0.02 * scale(exact)


# numerical method


@pytest.mark.sampled(1)
@pytest.mark.parametrize("layer", [BONDED, SLIP], ids=["bonded", "slip"])
def test_derivative_of_the_compliance_with_respect_to_stretch(layer):
    rows, step = mesh.graded_mesh(0.22, 0.02, 4), 1e-3
    wider, narrower = (
        compliance.surface_compliance(
            mesh.RowMesh(rows.x * (1 + side * step), rows.y), 0.3, layer, 0.03, True, 0
        ).response
        for side in (1, -1)
    )
    exact = compliance.stretch_derivative(rows, 0.3, layer, 0.03, True, 0).response
    assert np.abs((wider - narrower) / (2 * step) - exact).max() < 1e-5 * np.abs(exact).max()


def elastic_displacement(elastic, contact):
    """Displacement of the elastic layer at the surface nodes."""
    return elastic.displacement(contact.forces[:, elastic.loaded])


def accelerated_resistance(roller, speed, acceleration, steps, times, tolerance):
    """Resistance at a speed reached by constant acceleration, by second-order backward differences in time.

    (theta/step)(3/2 z - 2 z' + 1/2 z'') - v theta dz/dx + z = w,  from steady motion many creep times earlier
    """
    instant, (share,), (time,) = creep_function(MIX)
    step = times * time / steps
    problem = contact_problem.RollingProblem(SLIP, roller, MIX, speed - acceleration * step * steps)
    grid = fem_engine.initial_discretisation(problem, None, tolerance)  # the edges move on the mesh
    window, factor = contact_problem.WINDOW * grid.half_width, 1 + 1.5 * time / step
    elastic = contact_problem.elastic_surface(problem, grid.mesh, window)
    contact = contact_problem.solve_at_target(problem, contact_problem.steady_surface(problem, grid.mesh, window), grid)
    z = before = elastic_displacement(elastic, contact) @ retardation_operator(elastic.x, time * problem.speed).T
    for left in reversed(range(steps)):
        problem = replace(problem, speed=speed - acceleration * step * left)
        m = retardation_operator(elastic.x, time * problem.speed / factor) / factor
        decayed = time / step * (2 * z - before / 2) @ m.T
        surface = elastic.retarded(instant * np.eye(len(m)) + share * m)
        surface = replace(surface, initial=NodalField(elastic.x, share * decayed))
        contact = contact_problem.solve_at_target(problem, surface, grid, initial_guess=contact)
        before, z = z, elastic_displacement(elastic, contact) @ m.T + decayed
    return MIX.youngs_modulus * contact.resultant[0]


COARSE_TRANSIENT, FINE_TRANSIENT = (6, 6.0, 2e-3), (16, 8.0, 5e-4)  # steps, creep times, tolerance of the mesh
DEFORMED_SLIDING = roller_at(profile="deformed", friction=0.3, rolling="sliding")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("roller", "speed", "accuracy"),
    [
        pytest.param(DEFORMED_SLIDING, 0.3, COARSE_TRANSIENT, id="deformed sliding, coarse"),
        pytest.param(DEFORMED_SLIDING, 0.3, FINE_TRANSIENT, id="deformed sliding", marks=pytest.mark.slow),
        pytest.param(roller_at(profile="deformed"), 0.05, FINE_TRANSIENT, id="deformed", marks=pytest.mark.slow),
        pytest.param(DEEP, 0.05, FINE_TRANSIENT, id="load", marks=pytest.mark.slow),
    ],
)
def test_expansion_agrees_with_a_transient(roller, speed, accuracy):
    found = expand_resistance(SLIP, roller, MIX, speed, estimate=False)
    acceleration = 0.2 * UNSTEADINESS_LIMIT * speed / found.relaxation_time
    gaining, losing = (accelerated_resistance(roller, speed, side * acceleration, *accuracy) for side in (1, -1))
    assert (gaining - losing) / (2 * acceleration) == pytest.approx(found.added_mass, rel=5e-3)
    assert (gaining + losing) / 2 == pytest.approx(found.resistance, rel=5e-4)


def test_loaded_zone_widens_for_every_contact(monkeypatch):
    wide = expand_resistance(SLIP, roller_at(), MIX, 0.3, mesh=COARSE, estimate=False)
    monkeypatch.setattr(contact_problem, "WINDOW", 0.3)
    narrow = expand_resistance(SLIP, roller_at(), MIX, 0.3, mesh=COARSE, estimate=False)
    assert narrow.added_mass == pytest.approx(wide.added_mass, rel=1e-4)


@pytest.mark.slow
def test_stiffness_is_factorised_once(monkeypatch):
    calls, splu = [], compliance.splu
    monkeypatch.setattr(compliance, "splu", lambda *given, **options: calls.append(1) or splu(*given, **options))
    expand_resistance(Layer(0.21), roller_at(), MIX, 0.3, estimate=False)
    assert len(calls) == 1


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"speed": np.inf}, "`speed` must be finite, got inf"),
        ({"tolerance": 0.0}, "`tolerance` must be positive and finite, got 0.0"),
        (
            {"roller": roller_at(rolling="free", friction=0.3)},
            "without stick and slip only, got `rolling` 'free' with `friction` 0.3; use 'sliding' or no friction",
        ),
    ],
    ids=["speed", "tolerance", "stick"],
)
def test_invalid_argument_is_refused(change, words):
    given = {"layer": BONDED, "roller": roller_at(), "material": MIX, "speed": 0.3} | change
    with pytest.raises(ValueError, match=words):
        expand_resistance(**given)
