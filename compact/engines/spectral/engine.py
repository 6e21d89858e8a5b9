"""Engine "spectral": a roller on a linear layer of plies over a rigid base, solved in Fourier space.

Steady rolling on an elastic or viscoelastic layer, plane strain, bonded or slipping base, without friction or in
full slip with the traction f p. The pressure on the unknown contact |x - centre| <= a is

    p = (E* a/2R) (1 - xi)^(1 - alpha) (1 + xi)^alpha sum b_k Q_{k-1}(xi),    cot(pi alpha) = f (1 - 2 nu)/(2 - 2 nu),

which vanishes at both edges with the powers that the instant response demands (1/2 each without friction). Its
surface must have the slope of the roller, u' = -gap'. Tested with polynomials over the same edge powers this is one
linear system for the b_k, and one more row for the centre; `kernel` has its matrix, exact for the half-plane and
every creep branch, a short quadrature for the layer. What remains is one equation for a, from the indentation, the
load or the peak pressure. More modes are taken until the answer stands still.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.linalg import lu_factor, lu_solve
from threadpoolctl import threadpool_limits

from compact.engines.spectral import galerkin_system
from compact.engines.spectral.elastic_estimate import first_half_width, surface_modulus
from compact.material.laws import Elastic
from compact.numerics.validation import require_finite, require_known, require_positive
from compact.rolling_contact import ContactResult, require_on_target

TRACTION = {"frictionless": 0, "free": 0, "sliding": 1, "driven": -1}  # of the mix, along the travel
LADDER = (16, 24, 36, 54, 80, 120, 180, 270, 405, 610)  # modes tried in turn, each judged by the next
RTOL = 1e-5  # wanted relative error of load and resistance, a tenth of that of the peak pressure
ACCEPTED = 1e-3  # relative error above which the last of the ladder is a failure
STILL = 1e-12  # relative distance to the target at which the half-width is found
TARGET = 1e-9  # relative, within which what is prescribed is met
STEPS = 60  # of the half-width, at most
NUDGE = 1e-4  # relative change of the half-width that tells how load and resistance follow it
ROUNDING = 1e-13  # relative error by arithmetic, over the share of the compliance that is instant
CAUTION = 2.0  # times the change from one rung to the next
PEAK = 10  # times the error of the load that the peak pressure may have
REACH = 100.0  # half-widths times wave number to which the energy balance is summed wave by wave
SAMPLES = 201  # points along the contact, crowded to its edges where the pressure is steep
RESISTED = 1e-3  # share of the load below which a resistance counts as none, theory.md 3.1


@dataclass(frozen=True)
class Step:
    """One rung of the ladder: `modes` taken, `half_width` a [m], `load` [N/m], `resistance` [N/m], `error` of both."""

    modes: int
    half_width: float
    load: float
    resistance: float
    error: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class SpectralContactResult(ContactResult):
    """A `ContactResult` with what the spectral engine knows besides.

    indentation : delta [m]
    modes : polynomials taken for the pressure
    history : of `Step`s, one for each number of modes
    """

    indentation: float
    modes: int
    history: tuple[Step, ...]


def roll(layer, roller, material, speed, *, rtol=RTOL):
    """Steady rolling over a linear layer, a `SpectralContactResult`: the engine "spectral".

        int K(x - s) p(s) ds = indentation - gap(x) in contact,  p >= 0,
        resistance = int p gap' dx + f P

    Parameters
    ----------
    layer : Layer, of any height and plies; the contact may be a hundred times as wide as the top ply is thick
    roller : Roller, profile "parabola" or "circle", the gap being vertical; "frictionless", "sliding" (traction f p
        on the mix along the travel), "driven" (against it, full slip too), or "free" without friction
    material : Elastic or Viscoelastic, 0 <= nu < 0.5
    speed : of the roller along x [m/s], not 0; an elastic layer does not feel how fast
    rtol : wanted relative error of load and resistance; the default is a point of studies/speed_against_error.py,
        where 1e-3 is no faster

    Notes
    -----
    Small strains, no inertia. For speed < 0 leading and trailing stay + ahead, while x, shear_traction and resistance
    keep the fixed axis x. On a slipping base a sliding roller drags the whole layer along: it is taken to be held from
    behind, so that the layer ahead is free of stress, and the indentation counts from the surface there.

    References
    ----------
    K. L. Johnson, Contact Mechanics, CUP 1985, sections 2.7, 5.8; S. C. Hunter, J. Appl. Mech. 28 (1961) 611;
    F. Erdogan, G. D. Gupta, T. S. Cook 1973 for the Jacobi polynomials.

    >>> from compact.material.laws import Viscoelastic
    >>> from compact.rolling_contact import Layer, Roller
    >>> mix = Viscoelastic(10e6, 0.3, branches=((1.0, 0.1),))
    >>> rolled = roll(Layer(0.22), Roller(0.11, indentation=0.003), mix, speed=0.3)
    >>> f"load {rolled.load:.1f} N/m, resistance {rolled.resistance:.2f} N/m"
    'load 20455.8 N/m, resistance 392.89 N/m'
    """
    require_spectral_range(layer, roller, material, speed)
    require_positive(rtol=rtol)
    scene = scene_of(layer, roller, material, speed)
    first = first_half_width(layer, material, roller.radius, scene.target, scene.value)
    with threadpool_limits(1):  # matrices are small, threads only quarrel
        contact, history = _resolved(scene, min(first, scene.widest), rtol, np.sign(speed))
        rolled = _rolled(scene, contact, history, np.sign(speed))
    require_on_target(rolled, roller, TARGET)
    return rolled


def _resolved(scene, half_width, rtol, direction):
    """The `Contact` of as many modes as `rtol` asks for, and the `Step`s that led there."""
    history = []
    for modes, more in pairwise(LADDER):
        contact = settle(scene, modes, half_width, history)
        half_width, (*error, peak) = contact.half_width, _error(scene, contact, more)
        history.append(Step(modes, half_width, contact.load, direction * contact.resistance, tuple(error)))
        if max(*error, peak / PEAK) <= rtol:
            break
    if not max(*error, peak / PEAK) <= max(rtol, ACCEPTED):
        raise RuntimeError(f"{modes} modes reach a relative error of {max(error):.1g} only; {_told(history)}")
    return contact, history


@dataclass(frozen=True)
class Scene:
    """The task seen along the travel, speed > 0: everything but the half-width."""

    ground: galerkin_system.LayerResponse
    contact_modulus: float
    radius: float
    profile: str
    target: str
    value: float

    @property
    def widest(self):
        """Half-width [m] beyond which no contact is looked for: the circle ends at R."""
        return 0.9 * self.radius if self.profile == "circle" else np.inf

    def gap(self, x):
        """Height of the roller above its lowest point [m]: x^2/2R, or R - sqrt(R^2 - x^2) without its cancellation."""
        R = self.radius
        return x**2 / (2 * R if self.profile == "parabola" else R + np.sqrt(R**2 - x**2))

    def slope(self, x):
        """gap' [-] and gap'' [1/m]."""
        R = self.radius
        if self.profile == "parabola":
            return x / R, np.full_like(x, 1 / R)
        below = np.sqrt((R - x) * (R + x))
        return x / below, R**2 / below**3


@dataclass(frozen=True)
class Contact:
    """A solved `kernel.System`: `coefficients` b_k of the pressure, and what they come to."""

    system: galerkin_system.System
    centre: float
    coefficients: np.ndarray
    scale: float  # E* a/2R [Pa]
    indentation: float
    load: float
    resistance: float

    @property
    def half_width(self):
        return self.system.half_width

    def pressure(self, xi):
        """p [Pa] at xi in [-1, 1]."""
        alpha = self.system.basis.trailing_exponent
        shape = galerkin_system.pressure_polynomials(xi, alpha, len(self.coefficients))
        return self.scale * (1 - xi) ** (1 - alpha) * (1 + xi) ** alpha * (self.coefficients @ shape)

    @property
    def peak_place(self):
        """xi of the largest p, by looks ever closer."""
        centre, reach = 0.0, 1.0
        for _ in range(4):
            xi = np.clip(centre + reach * np.linspace(-1, 1, 41), -1, 1)
            centre, reach = xi[np.argmax(self.pressure(xi))], reach / 20
        return centre

    @property
    def peak_pressure(self):
        """Largest p [Pa]."""
        return self.pressure(self.peak_place)


def scene_of(layer, roller, material, speed):
    target, value = roller.target
    friction = TRACTION[roller.rolling] * roller.friction
    creep = galerkin_system.creep(getattr(material, "branches", ()), abs(speed), layer.height)
    return Scene(
        galerkin_system.LayerResponse(layer, material.poisson, friction, creep),
        contact_modulus=surface_modulus(layer, material),
        radius=roller.radius,
        profile=roller.profile,
        target=target,
        value=value,
    )


def settle(scene, modes, half_width, history):
    """The `Contact` of so many modes that meets the target: secant of the log of the target over log a."""
    a, miss, power, step = np.log(half_width), None, 2.0, 0.0
    for _ in range(STEPS):
        contact = _solve(scene, galerkin_system.system(scene.ground, modes, np.exp(a)), modes)
        reached = getattr(contact, scene.target)
        if not 0 < reached < np.inf:
            raise RuntimeError(
                f"no `{scene.target}` but {reached:.3g} at half-width {np.exp(a):.3g} m; {_told(history)}"
            )
        before, miss = miss, np.log(reached / scene.value)
        if abs(step) > NUDGE**2:
            power = np.clip((miss - before) / step, 0.5, 20)
        step = np.clip(-miss / power, -1, min(1, np.log(scene.widest) - a))
        if abs(miss) < STILL:
            return contact
        a += step
    raise RuntimeError(
        f"half-width not found in {STEPS} steps with {modes} modes, `{scene.target}` is off by {miss:.1g} of itself; "
        f"{_told(history)}"
    )


def _solve(scene, system, modes):
    """The `Contact` of the first so many modes: its surface has the slope of the roller, tested by as many T_m."""
    basis, R, a = system.basis, scene.radius, system.half_width
    tests = basis.tests[: modes + 1]
    body = lu_factor(system.rows[1 : modes + 1, :modes])
    edge = lu_solve(body, system.rows[0, :modes], trans=1)
    centre = _centre(scene, basis.nodes, a, tests[0] - edge @ tests[1:])
    b = lu_solve(body, tests[1:] @ scene.slope(centre + a * basis.nodes)[0] * (R / a))
    scale = scene.contact_modulus * a / (2 * R)
    load = scale * a * basis.unit_load * b[0]
    depth = a**2 / R * (system.depths[:modes] @ b) + tests[0] @ scene.gap(centre + a * basis.nodes)
    sideways = basis.pressures[:modes] @ scene.slope(centre + a * basis.seats)[0]
    return Contact(
        system,
        centre,
        b,
        scale,
        indentation=depth / tests[0].sum(),
        load=load,
        resistance=scale * a * (b @ sideways) + scene.ground.friction * load,
    )


def _centre(scene, nodes, a, row):
    """x of the middle of the contact [m] at which the row of T_0 is met too, by Newton."""
    centre = 0.0
    for _ in range(STEPS):
        if abs(centre) + a >= scene.radius and scene.profile == "circle":
            raise RuntimeError(f"the contact, {a:.3g} m about {centre:.3g} m, is wider than the circle; press less")
        slope, curvature = scene.slope(centre + a * nodes)
        step = (row @ slope) / (row @ curvature)
        centre -= step
        if abs(step) <= 1e-14 * a:
            return centre
    raise RuntimeError(f"centre of the contact not found in {STEPS} steps, last {step:.1g} m of {a:.3g} m")


def _error(scene, contact, more):
    """Estimated relative errors of load, resistance and peak pressure: what more modes change, and cannot see yet.

    The larger system, on the same half-width, misses the target, and so does, by a little, the contact; its values are
    carried back along the half-width. A load that is prescribed is exact: its error is that at the indentation found.
    """
    modes, a = len(contact.coefficients), contact.half_width
    nudged = _solve(scene, galerkin_system.system(scene.ground, modes, a * (1 + NUDGE)), modes)
    larger = _solve(scene, galerkin_system.system(scene.ground, more, a), more)
    names = ("load", "resistance", "peak_pressure", "indentation")
    here, aside, beyond = (np.array([getattr(c, name) for name in names]) for c in (contact, nudged, larger))

    def change(kept, value):
        k = names.index(kept)
        return beyond - here - (aside - here) / (aside[k] - here[k]) * (beyond[k] - value)

    as_deep = ("indentation", contact.indentation) if scene.target == "load" else (scene.target, scene.value)
    load = change(*as_deep)[0]
    changed = np.array([load, *change(scene.target, scene.value)[1:3]])
    scale = np.array([contact.load, max(abs(contact.resistance), RESISTED * contact.load), contact.peak_pressure])
    lost = contact.load * (_unseen(scene, contact) + ROUNDING / scene.ground.creep.instant)
    sideways = max(abs(scene.ground.friction), 2 * a / scene.radius)  # of the load that is lost, a resistance
    error = (CAUTION * np.abs(changed) + lost * np.array([1.0, sideways, 0.0])) / scale
    return tuple(error.tolist())


def _unseen(scene, contact):
    """Relative error of the load by branches too fast for the modes.

        1/2 sum modes share^2 y^3 exp(-modes^2 y),  y = relaxation length/half-width

    Polynomials of degree n see down to a/n^2 from an edge. A branch that is much shorter still has its full effect, but
    for its edge layer, which more modes do not change until they see it. Shares are stiffnesses of a branch over what
    is left once it, and faster ones, have relaxed. Fitted to 0.5-1 times this by systems of 600 modes with y 1e-5 to
    0.01, shares 0.1 to 10, contacts 0.2 and 1.5 heights wide on both bases, friction 0 and 0.6.
    """
    creep, modes = scene.ground.creep, len(contact.coefficients)
    crept = creep.shares / (creep.instant + np.cumsum(creep.shares))
    y = (1 - crept) * creep.lengths / contact.half_width
    return float(np.sum(0.5 * modes * (crept / (1 - crept)) ** 2 * y**3 * np.exp(-(modes**2) * y)))


def _told(history):
    """The history in words."""
    steps = (
        f"{step.modes} modes: a {step.half_width:.6g} m, load {step.load:.8g} N/m, error {max(step.error):.1g}"
        for step in history
    )
    return f"history: {'; '.join(steps) or 'none'}"


def _rolled(scene, contact, history, direction):
    """The contact as seen from the fixed axis x."""
    xi = -np.cos(np.linspace(0, np.pi, SAMPLES))
    pressure = contact.pressure(xi)
    forth = slice(None, None, int(direction))  # x ascends, whichever way the roller goes
    return SpectralContactResult(
        load=float(contact.load),
        resistance=float(direction * contact.resistance),
        leading=float(contact.centre + contact.half_width),
        trailing=float(contact.centre - contact.half_width),
        x=(direction * (contact.centre + contact.half_width * xi))[forth],
        pressure=pressure[forth],
        shear_traction=(direction * scene.ground.friction * pressure)[forth],
        error=history[-1].error,
        work_residual=_work_residual(scene, contact),
        indentation=float(contact.indentation),
        peak_pressure=float(contact.peak_pressure),
        modes=history[-1].modes,
        history=tuple(history),
    )


def _work_residual(scene, contact):
    """Resistance against dissipation, over the larger of resistance and 1e-3 load; theory.md 3.1.

        int p gap' dx = (2/pi E*) int_0^inf (L Im C - f M Re C) |p|^2 dk

    The right side is what the layer keeps of the work of p, from the Fourier transform of p and the complex
    compliance: none of the closed forms that gave the pressure enter. f p does work besides, on slipping and on
    stretching the surface, the same on both sides, which is left out. Past `REACH` |p|^2 falls like a power.
    """
    ground, basis, a = scene.ground, contact.system.basis, contact.half_width
    tau, weight, squared = galerkin_system.power_spectrum(basis, contact.coefficients, REACH)
    beyond = np.geomspace(REACH, 1e9 * REACH, 2001)
    power = 2 + 2 * min(basis.trailing_exponent, 1 - basis.trailing_exponent)
    level = np.average(squared * tau**power, weights=weight * (tau > REACH / 2))
    dissipated = np.sum(weight * ground.kept(tau / a) * squared)
    dissipated += np.trapezoid(ground.kept(beyond / a) * level * beyond ** (1 - power), np.log(beyond))
    dissipated *= 2 * a * contact.scale**2 / (np.pi * scene.contact_modulus)
    pushed = contact.resistance - ground.friction * contact.load
    return float(abs(pushed - dissipated) / max(abs(contact.resistance), RESISTED * contact.load))


def require_spectral_range(layer, roller, material, speed):
    require_finite(speed=speed)
    require_known("base", layer.base, ("bonded", "slip"))
    if speed == 0:
        raise ValueError("`speed` must not be 0, got 0: the resistance is set-valued there; say which way it goes")
    require_known("rolling", roller.rolling, TRACTION)
    require_known("profile", roller.profile, ("parabola", "circle", "deformed"))
    if roller.profile == "deformed":
        raise ValueError("the spectral engine needs `profile` 'parabola' or 'circle', got 'deformed'; use fem")
    if roller.rolling == "free" and roller.friction > 0:
        raise ValueError(
            f"the spectral engine knows full slip only, got `rolling` 'free', `friction` {roller.friction!r}; use fem"
        )
    if not isinstance(material, Elastic):
        raise ValueError(
            f"the spectral engine needs a `material` Elastic or Viscoelastic, got {type(material).__name__}; use fem"
        )
