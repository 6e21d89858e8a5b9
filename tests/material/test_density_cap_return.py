"""Return mapping to tables over the density: conditions of Koiter, tangents, the die, and the ellipse as a limit."""

import numpy as np
import pytest

from compact.material import density_cap_return as tables_return
from compact.material.cap_plasticity import MaterialPoint, compacted_state, initial_state, integrate_points
from compact.material.density_cap import DensityCap, density_dependent_cap
from compact.material.laws import Compaction
from compact.validation.powder import ph102

pytestmark = pytest.mark.slow  # the kernels of this law compile for seconds
LAW = density_dependent_cap(ph102(), 0.4)
TABLES = tables_return.table_constants(LAW, 1.0)
DEVIATOR = np.array([1.0, 1.0, 1.0, 2.0])  # weights of xx, yy, zz, xy in a product of deviators


def at(k):
    K, _, G, _, pa, _, a, _, R, _, d, _, t, _ = tables_return.evaluate_tables(TABLES, k)
    return K, G, pa, a, R, d, t


def random_steps(count, smallest):
    """Yield states on or inside the yield surface, strain increments and carried pressures."""
    rng = np.random.default_rng(1)
    for number in range(count):
        densest = rng.uniform(0.42, 0.98)
        k = densest * (1 - rng.choice([0.0, 0.02]) * rng.uniform())
        K, _, pa, a, R, d, t = at(densest)
        p = rng.uniform(-d / t, pa + a)
        limit = d + t * p if p < pa else np.sqrt(max(a * a - (p - pa) ** 2, 0.0)) / R
        deviator = rng.normal(size=4)
        deviator[:3] -= deviator[:3].mean()
        deviator *= rng.uniform() * limit / np.sqrt(1.5 * deviator**2 @ DEVIATOR)
        stress = deviator - p * np.array([1.0, 1.0, 1.0, 0.0])
        strain = rng.normal(size=3) * a / K * 10 ** rng.uniform(smallest, 0.5)
        yield (*stress, k, densest), strain, np.nan if number % 2 else rng.uniform(-d / t, pa + a)


def step(before, strain, carried, derivatives=None):
    derivatives = np.empty((6, 0)) if derivatives is None else derivatives
    good, after, _, _ = tables_return.integrate_table_point(
        TABLES, tuple(before), tuple(strain), 0.0, 1.0, carried, derivatives
    )
    assert good
    return np.array(after)


def conditions(before, strain, carried):
    """Return the part of the surface on which a step ends, and the residuals of Koiter's conditions there."""
    after = step(before, strain, carried)
    K, G, *_ = at(before[5])
    stress, mean, third = np.array(before[:4]), sum(before[:3]) / 3, (strain[0] + strain[1]) / 3
    sphere = np.array([1.0, 1.0, 1.0, 0.0])
    shape = (stress - mean * sphere) / (2 * G) + np.array([strain[0], strain[1], 0.0, strain[2] / 2]) - third * sphere
    volume, shear = -mean / K - 3 * third, np.sqrt(shape**2 @ DEVIATOR / 1.5)
    K, G, pa, a, R, d, t = at(after[5])
    p = -after[:3].sum() / 3
    deviator = after[:4] + p * sphere
    q, V = np.sqrt(1.5 * deviator**2 @ DEVIATOR), np.log(after[4] / before[4])
    flow = shear - q / (3 * G)  # plastic shear strain
    y, place = p - pa, p if np.isnan(carried) else carried
    limit = d + t * min(max(place, -d / t), pa)
    found = [
        abs(V - volume + p / K) / abs(volume),
        np.abs(deviator / (2 * G) - shape * q / (3 * G * shear)).max() / shear,
    ]
    cap = (np.hypot(y, R * q) - a) / a if y > 0 else -1.0
    found += [max(cap, 0.0), max(q - limit, 0.0) / a, max(-(d + t * p), 0.0) / a, max(-flow, 0.0) / shear]
    if abs(V) < 1e-15 and flow < 1e-13 * shear:
        return "elastic", found
    on_line = abs(q - limit) < 1e-12 * a
    if cap > -1e-9:  # normality: R^2 q V = y e on the cap; more shear at its corner with a carried line
        excess = (y * flow - R * R * q * V) / (a * shear)
        corner = on_line and limit < a / R * (1 - 1e-12)
        return "corner" if corner else "cap", [*found, max(-V, 0.0), max(-excess, 0.0) if corner else abs(excess)]
    if d + t * p < 1e-12 * a and V < 0:
        return "apex", found
    return "line", [*found, abs(V / volume), 0.0 if on_line else 1.0]


def test_steps_satisfy_the_conditions_of_koiter():
    results = [conditions(*each) for each in random_steps(3000, -3)]
    assert max(max(residuals) for _, residuals in results) < 1e-12
    names = [name for name, _ in results]
    assert all(names.count(name) > 20 for name in ("elastic", "cap", "line", "apex", "corner"))


def test_tangents_agree_with_differences():
    rng = np.random.default_rng(2)
    errors = []
    for before, strain, carried in random_steps(150, -2):
        before, K = np.array(before), at(before[5])[0]
        given = rng.normal(size=(6, 3)) * np.array([at(before[5])[3]] * 4 + [0.1] * 2)[:, None]
        if before[4] == before[5]:
            given[5] = given[4]
        derivatives = given.copy()
        step(before, strain, carried, derivatives)

        def moved(z, before=before, strain=strain, carried=carried, given=given, K=K):
            point = before + np.append(given[:4] @ z, np.zeros(2))
            point[4:] *= np.exp(given[4:] @ z)
            after = step(point, strain + z, carried)
            return np.append(after[:4] / K, np.log(after[4:]))

        h = 1e-7
        found = [
            (8 * (moved(h * u) - moved(-h * u)) - moved(2 * h * u) + moved(-2 * h * u)) / (12 * h) for u in np.eye(3)
        ]
        errors.append(np.abs(np.array(found).T - derivatives / np.array([K] * 4 + [1.0] * 2)[:, None]).max())
    assert max(errors) < 1e-7


@pytest.mark.parametrize("k", [0.35, 0.47, 0.77, 0.985])
def test_derivatives_of_the_tables(k):
    h = 1e-6
    ends = [np.array(tables_return.evaluate_tables(TABLES, k * np.exp(side))) for side in (-h, h)]
    values = np.array(tables_return.evaluate_tables(TABLES, k))
    assert (ends[1] - ends[0])[::2] / (2 * h) == pytest.approx(values[1::2], rel=1e-7)


def test_oedometer_of_the_kernel_is_the_die_of_the_tables():
    path, state, rows = LAW.tables.die(0.4, 0.85, 400), initial_state(LAW, 1), []
    increment = np.array([[0.0, -np.log(0.85 / 0.4) / 400, 0.0]])
    for _ in path.density_ratio[1:]:
        state, _ = integrate_points(LAW, state, increment, tangent=False)
        rows.append([state.density_ratio[0], *-state.stress[0, [1, 0, 2]]])
    density, axial, radial, out_of_plane = np.array(rows).T
    assert density == pytest.approx(path.density_ratio[1:], rel=1e-12)
    assert axial == pytest.approx(path.axial_stress[1:], rel=1e-11)
    assert radial == pytest.approx(path.radial_stress[1:], rel=1e-11)  # on the wall of the die
    assert out_of_plane == pytest.approx(radial, rel=1e-12)
    assert 0.4 < radial[-1] / axial[-1] < 0.65  # as published


def test_level_line_and_constant_slopes_are_the_flat_ellipse():
    ellipse = Compaction(120e6, 0.3, 13e-6, 0.72, 1.2, 14e3, 0.9)
    density = 0.72 + 0.279 * np.linspace(0.3, 0.97, 400)
    pc = ellipse.yield_pressure(density)
    same = (np.full(400, value) for value in (1e-6, 1 / 1.2))
    angle, eccentricity = same
    table = DensityCap(
        *map(tuple, (density, pc, 1.2 * (pc + 14e3) / 2, angle, eccentricity)), (0.7, 1.0), (120e6,) * 2, (0.3,) * 2
    )
    rng, points = np.random.default_rng(3), 300
    k, p = rng.uniform(0.88, 0.96, points), rng.uniform(10e3, 40e3, points)
    stress = -p[:, None] * np.array([1.0, 1.0, 1.0, 0.0]) + rng.uniform(-2e3, 2e3, (points, 4))
    state = MaterialPoint(stress, k, k.copy(), np.zeros(points))
    strain = rng.normal(size=(points, 3)) * 5e-4 - np.array([5e-4, 5e-4, 0.0])
    (one, tangent), (other, other_tangent) = (
        integrate_points(law, state, strain) for law in (ellipse, density_dependent_cap(table, 0.9))
    )
    inside = -one.stress[:, :3].mean(axis=1) > 0  # the line has no tension cut-off there
    assert inside.sum() > 200
    assert other.stress[inside] == pytest.approx(one.stress[inside], abs=2e-6 * 60e3)
    assert other.density_ratio[inside] == pytest.approx(one.density_ratio[inside], rel=1e-9)
    assert tangent is not None
    assert other_tangent is not None
    assert np.median(np.abs(other_tangent - tangent)[inside].max(axis=(1, 2))) < 1e-4 * 160e6


def test_powder_of_an_earlier_pass_keeps_a_lateral_stress():
    point = compacted_state(LAW, 0.6)
    assert point.density_ratio[0] == pytest.approx(0.6, abs=1e-12)
    assert point.stress[0] == pytest.approx([-8.81e6, 0.0, -8.81e6, 0.0], rel=2e-3)


def test_beyond_the_tables_the_pressure_continues_along_its_tangent():
    density = np.array([0.998, 0.999, 1.001])
    pressure = LAW.yield_pressure(density)
    end = LAW.tables.curves[0](np.log(0.999), 1) * pressure[1]
    assert pressure[2] - pressure[1] == pytest.approx(end * np.log(1.001 / 0.999), rel=1e-12)
    found = [sum(tables_return.evaluate_tables(TABLES, k)[4:7:2]) for k in density.tolist()]
    assert found == pytest.approx(pressure, rel=1e-12)


def test_fed_density_outside_the_tables_is_refused():
    with pytest.raises(ValueError, match=r"`fed_density_ratio` must lie within the tables of the cap, above 0.3"):
        density_dependent_cap(ph102(), 0.3)
