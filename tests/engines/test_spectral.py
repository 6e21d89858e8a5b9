"""Engine "spectral": creep matrices against mpmath, closed forms, published tables, limits, balances, errors."""

import mpmath
import numpy as np
import pytest
from rolling_scenes import HEIGHT as H
from rolling_scenes import LAYER, MIX, SPEED, R, assert_estimates

from compact.engines.halfplane import galin, hertz
from compact.engines.spectral import engine as spectral
from compact.engines.spectral.engine import build_rolling_problem, solve_contact
from compact.engines.spectral.galerkin_system import build_jacobi_basis, creep_branch_matrices, creep_compliance
from compact.material.laws import Elastic, Viscoelastic
from compact.rolling_contact import Layer, Roller

SOLID = Viscoelastic(youngs_modulus=10e6, poisson=0.3, branches=((1.0, 0.1),))  # table g
DECADES = Viscoelastic(youngs_modulus=10e6, poisson=0.3, branches=tuple((0.5, 10.0**power) for power in range(-6, 1)))


def pressed(indentation=0.003, **other):
    return Roller(R, indentation=indentation, **other)


def exponential_rule(low=-60.0, high=6.0, count=1201):
    """Nodes t of (0, inf) and weights of dt by the trapezoid rule in log t."""
    s = np.linspace(low, high, count)
    return np.exp(s), np.exp(s) * (s[1] - s[0])


# creep


def test_creep_is_the_inverse_of_the_complex_modulus():
    creep = creep_compliance(DECADES, speed=0.7, height=H)
    k = np.geomspace(1e-8, 1e12, 401)
    modulus = DECADES.complex_modulus(-0.7 * k) / DECADES.youngs_modulus  # d/dt = -v d/dx
    assert np.max(np.abs(creep.at(k) * modulus - 1)) < 1e-8
    assert creep.instant + creep.shares.sum() == pytest.approx(1, rel=1e-14)


@pytest.mark.parametrize("beta", [1e-6, 1e-3, 0.3, 1.0, 30.0, 2e3])
def test_creep_branch_matrix_without_friction_has_bessel_functions(beta):
    matrix = creep_branch_matrices(np.array([beta]), 0.5, 24)[0]
    for m, k in ((0, 1), (1, 1), (0, 2), (3, 2), (2, 5), (24, 24), (24, 1), (5, 24)):
        Z = 2 * mpmath.besseli(max(m, k), beta) * mpmath.besselk(min(m, k), beta)
        expected = (m == k) - k * Z if m >= k else -((-1) ** (m + k)) * k * Z
        assert matrix[m, k - 1] == pytest.approx(float(expected), rel=2e-8, abs=1e-13)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("exponent", [0.35, 0.47, 0.62])
@pytest.mark.parametrize("beta", [0.05, 2.0, 40.0, 1e3])
def test_creep_branch_matrix_of_galins_pressure(exponent, beta):
    """The slope under (1 - x)^A (1 + x)^B has a closed form beyond the contact: x - x0 - (x - 1)^A (x + 1)^B."""
    A, B, modes = 1 - exponent, exponent, 10
    t, weight = exponential_rule()
    ahead = beta * np.sum(weight / beta * np.exp(-t) * (t / beta) ** A * (2 + t / beta) ** B)
    basis = build_jacobi_basis(exponent, modes, 600)
    x = basis.nodes
    slope = x - (1 - 2 * B) + 1 / beta - np.exp(-beta * (1 - x)) * ahead
    expected = basis.tests @ slope / np.sin(np.pi * exponent) / basis.unit_load
    assert creep_branch_matrices(np.array([beta]), exponent, modes)[0, :, 0] == pytest.approx(expected, abs=3e-9)


# closed form: half-plane


@pytest.mark.parametrize("target", ["load", "peak_pressure"])
def test_high_layer_is_hertz(target):
    closed = hertz(radius=R, load=1e3, contact_modulus=MIX.contact_modulus)
    rolled = spectral.roll(Layer(1e4), Roller(R, **{target: getattr(closed, target)}), MIX, 1.0)
    assert rolled.leading == pytest.approx(closed.half_width, rel=1e-8)
    assert (rolled.load, rolled.peak_pressure) == pytest.approx((closed.load, closed.peak_pressure), rel=1e-8)
    assert rolled.pressure == pytest.approx(closed.pressure(rolled.x), rel=1e-6, abs=1e-6 * closed.peak_pressure)


@pytest.mark.sampled(6)
@pytest.mark.parametrize("rolling", ["sliding", "driven"])
@pytest.mark.parametrize("friction", [0.1, 0.5, 1.0])
@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.49])
def test_high_layer_is_galin(poisson, friction, rolling):
    sign = {"sliding": 1, "driven": -1}[rolling]
    closed = galin(radius=R, youngs_modulus=1e7, poisson=poisson, friction=sign * friction, load=1e3)
    roller = Roller(R, load=1e3, friction=friction, rolling=rolling)
    rolled = spectral.roll(
        Layer(1e6 * closed.contact_length), roller, Elastic(youngs_modulus=1e7, poisson=poisson), 1.0
    )
    assert (rolled.leading, rolled.trailing) == pytest.approx((closed.leading, closed.trailing), rel=2e-6)
    assert rolled.peak_pressure == pytest.approx(closed.peak_pressure, rel=1e-7)
    assert rolled.resistance == pytest.approx(1e3 * (sign * friction + closed.centroid / R), rel=1e-7)


def hunter(length, ratio, half_width=1.0, radius=100.0, modulus=1.0):
    """Load and resistance of a standard linear half-plane (contact.md d); length = speed creep time."""
    a, long, short = half_width, mpmath.mpf(length), mpmath.mpf(length) / ratio
    beta, gamma = a / long, a / short
    I1, I0 = (mpmath.besseli(n, gamma) for n in (1, 0))
    K0, K1 = (mpmath.besselk(n, beta) for n in (0, 1))
    lowest = -(long - short) * I1 * K0 / (I1 * K0 + I0 * K1)
    load = mpmath.pi * modulus / (4 * radius) * (a**2 - 2 * lowest * a * K1 / K0)
    moment = mpmath.pi * modulus * a**2 / (4 * radius) * (lowest + long) - (short + lowest) * load
    return float(load), float(moment / radius), float(-lowest)


@pytest.mark.sampled(6)
@pytest.mark.parametrize("ratio", [2, 10])
@pytest.mark.parametrize("deborah", [1e-4, 1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0, 1e4])
def test_high_viscoelastic_layer_is_hunter(deborah, ratio):
    load, resistance, centre = hunter(deborah, ratio)
    mix = Viscoelastic(youngs_modulus=0.91, poisson=0.3, branches=((ratio - 1.0, deborah / ratio),))
    rolled = spectral.roll(Layer(1e8), Roller(100.0, load=load), mix, 1.0)
    assert rolled.resistance == pytest.approx(resistance, rel=5e-6)
    assert (rolled.leading - rolled.trailing) / 2 == pytest.approx(1, rel=1e-5)
    assert (rolled.leading + rolled.trailing) / 2 == pytest.approx(centre, abs=2e-5)


# order


def test_error_falls_geometrically_with_the_modes():
    problem, _ = build_rolling_problem(LAYER, pressed(), SOLID, 0.1)
    modes = np.array([4, 8, 12])
    reference = solve_contact(problem, 40, 0.013)
    contacts = [solve_contact(problem, int(count), 0.013) for count in modes]
    errors = [abs(contact.resistance / reference.resistance - 1) for contact in contacts]
    rate = -np.polyfit(modes, np.log(errors), 1)[0]
    assert rate > 1, f"error falls by exp(-{rate:.2f}) a mode"


# limits


@pytest.mark.sampled(6)
@pytest.mark.parametrize("base", ["bonded", "slip"])
@pytest.mark.parametrize("poisson", [0.0, 0.49, 0.4999])
@pytest.mark.parametrize("indentation", [1e-6, 1e-3, 0.3])
def test_extreme_elastic_contacts_are_solved(indentation, poisson, base):
    rolled = spectral.roll(Layer(H, base=base), pressed(indentation), Elastic(youngs_modulus=1e7, poisson=poisson), 1.0)
    assert rolled.indentation == pytest.approx(indentation, rel=1e-9)
    assert max(rolled.error) < 1e-5
    assert abs(rolled.resistance) < 1e-9 * rolled.load
    assert rolled.pressure.min() >= -1e-6 * rolled.peak_pressure


@pytest.mark.parametrize("ratio", [0.02, 5.0])
@pytest.mark.parametrize("mix", [MIX, SOLID], ids=["elastic", "viscoelastic"])
def test_extreme_contact_widths_are_solved(ratio, mix):
    start = spectral.roll(LAYER, pressed((ratio * H) ** 2 / R), mix, 0.1 * ratio)
    again = spectral.roll(LAYER, Roller(R, load=start.load), mix, 0.1 * ratio)
    assert again.indentation == pytest.approx(start.indentation, rel=1e-8)
    assert max(start.error) < 1e-5
    assert start.work_residual < 5e-3


@pytest.mark.parametrize("speed", [1e-8, 1e-4, 1e-2, 1.0, 1e2, 1e6])
def test_relaxation_times_over_six_decades(speed):
    rolled = spectral.roll(LAYER, pressed(), DECADES, speed)
    assert rolled.resistance > 0
    assert max(rolled.error) < 1e-5
    assert rolled.work_residual < 5e-3
    relaxed, instant = 15085.0135, 15085.0135 * 4.5
    assert relaxed <= rolled.load <= instant


@pytest.mark.parametrize(("speed", "share"), [(1e-12, 1.0), (1e-200, 1.0), (1e9, 2.0), (1e200, 2.0)])
def test_limits_of_low_and_high_speed_are_elastic(speed, share):
    rolled = spectral.roll(LAYER, pressed(), SOLID, speed)
    elastic = spectral.roll(LAYER, pressed(), Elastic(youngs_modulus=share * 10e6, poisson=0.3), 1.0)
    assert rolled.load == pytest.approx(elastic.load, rel=1e-7)
    assert abs(rolled.resistance) < 1e-6 * rolled.load


def test_resistance_at_low_speed_is_proportional_to_speed():
    slow, slower = (spectral.roll(LAYER, pressed(), SOLID, v) for v in (1e-6, 1e-9))
    assert slow.resistance / slower.resistance == pytest.approx(1e3, rel=2e-5)  # the next order is length/a
    assert slow.resistance / slow.load == pytest.approx(1e-6 * 0.1 / R, rel=1e-4)  # v (tc - tr)/R


# the surface by a direct Fourier integral over the pressure of the result


def fourier_surface(rolled, layer, material, friction, speed, x):
    """Depth of the surface at x from pressure samples (x positive ahead, speed > 0); zero far ahead."""
    k = np.geomspace(1e-7, 120 / (rolled.leading - rolled.trailing) * 2, 40001)
    half, middle = (rolled.leading - rolled.trailing) / 2, (rolled.leading + rolled.trailing) / 2
    angle = np.linspace(0, np.pi, len(rolled.x))
    weight = rolled.pressure * half * np.sin(angle) * (angle[1] - angle[0])
    transform = np.exp(-1j * k[:, None] * (middle - half * np.cos(angle))) @ weight
    z, nu = np.minimum(k * layer.height, 300), material.poisson
    K, b = 3 - 4 * nu, (1 - 2 * nu) / (2 - 2 * nu)
    if layer.base == "bonded":
        below = 2 * K * np.cosh(2 * z) + 4 * z**2 + 1 + K**2
        L = (2 * K * np.sinh(2 * z) - 4 * z) / below
        M = (2 * K * b * (np.cosh(2 * z) - 1) - 2 * z**2 / (1 - nu)) / below
    else:
        below = np.sinh(2 * z) + 2 * z
        L = (np.cosh(2 * z) - 1) / below
        M = (b * np.sinh(2 * z) - z / (1 - nu)) / below
    modulus = material.contact_modulus
    if isinstance(material, Viscoelastic):
        modulus = material.complex_modulus(-speed * k) / (1 - nu**2)
    depth = 2 / modulus * (L - 1j * friction * M) / k * transform
    ahead = friction * M[0] * rolled.load / material.contact_modulus
    return np.array([np.trapezoid((depth * np.exp(1j * k * at)).real * k, np.log(k)) / np.pi for at in x]) - ahead


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("mix", "friction", "base"),
    [(MIX, 0.0, "slip"), (MIX, 0.3, "bonded"), (SOLID, 0.0, "bonded"), (SOLID, 0.3, "slip"), (SOLID, -0.8, "bonded")],
    ids=lambda value: type(value).__name__.lower() if value in (MIX, SOLID) else str(value),
)
def test_surface_has_the_shape_of_the_roller(mix, friction, base):
    layer, rolling = Layer(H, base=base), "sliding" if friction >= 0 else "driven"
    rolled = spectral.roll(layer, pressed(0.02, friction=abs(friction), rolling=rolling), mix, 0.5)
    x = rolled.trailing + (rolled.leading - rolled.trailing) * np.array([0.15, 0.35, 0.6, 0.85])
    depth = fourier_surface(rolled, layer, mix, friction, 0.5, x)
    assert depth == pytest.approx(0.02 - x**2 / (2 * R), abs=2e-4 * 0.02)


# error estimate


@pytest.mark.parametrize("scenes", [slice(1, 2), pytest.param(slice(60), marks=pytest.mark.slow)], ids=["few", "many"])
def test_error_estimate_covers_the_true_error(scenes):
    """The reference has 200 modes, or twice as many as the result; rounding is 1e-11."""

    def reference(layer, mix, rolled, roller):
        (problem, _), width = build_rolling_problem(layer, roller, mix, SPEED), rolled.leading - rolled.trailing
        return solve_contact(problem, max(200, 2 * rolled.history[-1][0]), width / 2)

    assert_estimates(scenes, spectral.roll, reference, rounding=1e-11, rest=2e-10)


# refused arguments and failures


@pytest.mark.parametrize("exponent", [0.35, 0.5, 0.62])
def test_transforms_agree_with_direct_integrals_of_the_pressure(exponent):
    basis = build_jacobi_basis(exponent, 12, 60)
    tau = np.array([1e-10, 1e-3, 1.0, 10.0])
    direct = basis.pressures @ np.exp(-1j * np.multiply.outer(basis.pressure_nodes, tau))
    signs = (-1.0) ** np.arange(12)
    assert np.max(np.abs(signs[:, None] * basis.transforms(tau)[1:] - direct)) < 1e-12
