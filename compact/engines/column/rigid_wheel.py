"""Rigid wheel on terrain of a pressure-sinkage law: load, sinkage, drawbar, torque and slip.

    P = R int (sigma cos t + tau sin t) dt,   D = R int (tau cos t - sigma sin t) dt,   T = R^2 int tau dt

t is the angle from the vertical, positive ahead, over the contact from the exit to the entry angle t1. Columns have

    sigma = p(z),  z = R (cos t - cos t1),  tau from the displacement j = R [(t1 - t) - V (sin t1 - sin t)]

with V the travel over the rim speed. P is then the integral of p over the horizontal for a wheel without shear, and -D
is that of p over the sinkage. Behind the lowest point the pressure falls by the rebound modulus.

Wong and Reece place the largest stress at t_m ahead of the lowest point and mirror the law behind it. A wheel with skid
has t_m where its shear stress changes sign,

    tan(pi/4 - phi/2) = (cos t_m - 1/V)/sin t_m

with displacements that begin anew there. Slip is s = (rim speed - travel)/(the larger of both). All forces are per unit
width of the wheel. The integrals converge to 1e-11; laws z^n are integrable at the entry for any n > 0.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.special import gamma

from compact import rolling_contact
from compact.material.pressure_sinkage import PowerSinkage, Terrain
from compact.numerics import Array
from compact.numerics.validation import require_known, require_that

NODES, WEIGHTS = np.polynomial.legendre.leggauss(32)
GRADING = 6  # [-], power of the coordinate that removes the singularity of z^n at the ends of the contact
INTEGRATION_RTOL = 1e-12  # [-], change of the integrals between two numbers of intervals
INTERVALS_MAX = 64  # [-], of one piece of the contact
ANGLE_MIN, ANGLE_MAX = 1e-6, np.pi / 2 - 1e-6  # [rad], range of the entry angle
SLIP_STEPS = (0.03, 0.1, 0.2, 0.3, 0.45, 0.6, 0.75, 0.9, 0.999)  # [-], magnitudes in the search for a torque
TRIAL_ANGLES = 16  # [-], entry angles in the search for one that bears the load
ROOT_RTOL = 4e-15  # [-], of entry angle and slip
ANGLE_XTOL, ROOT_XTOL = 1e-16, 1e-15  # [rad], of the entry angle; [rad] and [-], of other angles and of the slip
PEAK_MARGIN = 1e-9  # [-], of the entry angle above that at which the largest stress leaves the contact
BISECTIONS = 60  # [-], of the search for the last finite angle; the interval is then rounding
SAMPLES = 201  # [-], points of the result along the contact
TARGET_RTOL = 1e-9  # [-], residual of a prescribed quantity that is guaranteed


@dataclass(frozen=True, kw_only=True)
class WheelContactResult(rolling_contact.ContactResult):
    """`ContactResult` of a rigid wheel, per unit width.

    Parameters
    ----------
    indentation : float
        Sinkage of the lowest point [m].
    entry_angle, exit_angle : float
        Angles of the edges from the vertical [rad], the exit angle negative behind the lowest point.
    peak_angle : float
        Angle of the largest normal stress [rad].
    slip : float
        (rim speed - travel)/(the larger of both) [-]; nan for a wheel without shear.
    drawbar : float
        Pull of the terrain on the wheel along the travel [N/m], minus the resistance.
    torque : float
        Torque on the wheel in the sense of rolling [N].
    compaction_resistance : float
        Integral of the pressure over the sinkage, without rebound [N/m].
    exit_height : float
        Height of the layer behind the wheel [m].
    """

    indentation: float
    entry_angle: float
    exit_angle: float
    peak_angle: float
    slip: float
    drawbar: float
    torque: float
    compaction_resistance: float
    exit_height: float


class _Forces(NamedTuple):
    load: float
    drawbar: float
    torque: float
    work: float
    error: float  # [-], of load and drawbar over the larger of both


@dataclass(frozen=True)
class WheelContact:
    """Wheel at an entry angle and a slip.

    Parameters
    ----------
    terrain : Terrain
        Laws of the terrain.
    radius, height : float
        Radius of the wheel [m] and height of the layer [m].
    entry_angle : float
        Angle t1 [rad].
    slip : float
        Slip s [-], -1 < s < 1.
    """

    terrain: Terrain
    radius: float
    height: float
    entry_angle: float
    slip: float

    @property
    def travel_ratio(self) -> float:
        """Travel over the rim speed V [-]."""
        return 1 - self.slip if self.slip >= 0 else 1 / (1 + self.slip)

    @property
    def sinkage(self) -> float:
        """Sinkage of the lowest point [m]."""
        return 2 * self.radius * np.sin(self.entry_angle / 2) ** 2

    @property
    def peak_angle(self) -> float:
        """Angle of the largest normal stress t_m [rad]."""
        terrain = self.terrain
        if terrain.peak is None or terrain.shear is None:
            return 0.0
        if self.slip >= 0:
            return (terrain.peak.c1 + terrain.peak.c2 * self.slip) * self.entry_angle
        tangent = np.tan(np.pi / 4 - np.radians(terrain.shear.friction_angle) / 2)
        return float(np.arccos(1 / (self.travel_ratio * np.hypot(1, tangent))) - np.arctan(tangent))

    @property
    def exit_angle(self) -> float:
        """Angle of the rear edge [rad], 0 without rebound."""
        modulus = self.terrain.rebound_modulus
        if not np.isfinite(modulus):
            return 0.0
        rise = float(self.law_at(self.sinkage)) / modulus
        if rise >= self.sinkage:
            raise ValueError(
                f"`rebound_modulus` must exceed {float(self.law_at(self.sinkage)) / self.sinkage:.3g} Pa/m at this "
                f"sinkage, got {modulus!r}: the terrain would rise above its surface"
            )
        return -2 * float(np.arcsin(np.sqrt(rise / (2 * self.radius))))

    def law_at(self, sinkage: float | Array) -> Array:
        """Return the pressure [Pa] of the law at sinkages [m]."""
        return self.terrain.law.pressure(sinkage, self.height)

    def stresses(self, angle: Array) -> tuple[Array, Array]:
        """Compute normal and shear stress on the wheel [Pa] at angles [rad] within the contact."""
        peak = self.peak_angle
        if self.terrain.peak is not None:
            mirrored = self.entry_angle - angle * (self.entry_angle - peak) / peak if peak else angle
            sigma = self.law_at(self._depth(np.where(angle >= peak, angle, mirrored)))
        else:
            sigma = self.law_at(self._depth(np.maximum(angle, 0.0)))
            if np.isfinite(self.terrain.rebound_modulus):
                rise = 2 * self.radius * np.sin(np.minimum(angle, 0.0) / 2) ** 2
                sigma = np.maximum(sigma - self.terrain.rebound_modulus * rise, 0.0)
        if self.terrain.shear is None:
            return sigma, np.zeros_like(sigma)
        return sigma, self.terrain.shear.stress(sigma, self._displacement(angle, peak))

    def _depth(self, angle: Array) -> Array:
        """Return the sinkage [m] of the rim at angles [rad], without cancellation at the entry."""
        t1 = self.entry_angle
        return np.maximum(2 * self.radius * np.sin((t1 + angle) / 2) * np.sin((t1 - angle) / 2), 0.0)

    def _displacement(self, angle: Array, peak: float) -> Array:
        """Return the signed shear displacement j [m] at angles [rad]."""
        t1, V, R = self.entry_angle, self.travel_ratio, self.radius
        if self.terrain.peak is None or self.slip >= 0:
            return R * (t1 - angle - V * (np.sin(t1) - np.sin(angle)))
        front = V * ((np.sin(t1) - np.sin(peak)) / (t1 - peak) * (t1 - angle) - np.sin(t1) + np.sin(angle))
        rear = peak - angle - V * (np.sin(peak) - np.sin(angle))
        return R * np.where(angle >= peak, front, rear)

    def forces(self) -> _Forces:
        """Integrate load, drawbar, torque and work of compaction per unit width."""
        pieces, count, before = self._pieces(), 1, np.full(4, np.inf)
        while True:
            found = np.sum([self._integrate(start, end, count) for start, end in pieces], axis=0)
            change = float(np.abs(found - before)[:2].max()) / float(np.abs(found[:2]).max())
            if change <= INTEGRATION_RTOL or count >= INTERVALS_MAX:
                load, drawbar, torque, work = found.tolist()
                return _Forces(load, drawbar, torque, work, change)
            count, before = 2 * count, found

    def _pieces(self) -> list[tuple[float, float]]:
        """Return intervals of the contact between knots; the first end is the one with the singularity."""
        t1, peak, t2 = self.entry_angle, self.peak_angle, self.exit_angle
        if not t2 <= peak < t1:
            raise ValueError(
                f"the largest stress must lie within the contact, got {np.degrees(peak):.3g} degrees between "
                f"{np.degrees(t2):.3g} and {np.degrees(t1):.3g} degrees; use a smaller slip or skid"
            )
        depths = self.terrain.law.knots(self.height)
        depths = depths[(depths > 0) & (depths < self.sinkage)]
        cuts = np.arccos(np.clip(np.cos(t1) + depths / self.radius, -1, 1))
        cuts = np.concatenate([cuts, self._reversals()])
        front = np.unique(np.concatenate([[peak], cuts[(cuts > peak) & (cuts < t1)], [t1]]))
        if self.terrain.peak is not None and peak > 0:
            cuts = np.concatenate([cuts, (t1 - cuts) * peak / (t1 - peak)])
        rear = np.unique(np.concatenate([[t2], cuts[(cuts > t2) & (cuts < peak)], [peak]]))
        return [(b, a) for a, b in pairwise(front)] + [(a, b) for a, b in pairwise(rear) if b > a]

    def _reversals(self) -> Array:
        """Return the angles [rad] at which the shear displacement of columns under a wheel with skid changes sign."""
        if self.terrain.peak is not None or self.terrain.shear is None or self.slip >= 0:
            return np.empty(0)
        t1, turn = self.entry_angle, float(np.arccos(1 / self.travel_ratio))  # largest displacement

        def displacement(angle: float) -> float:
            return float(self._displacement(np.array(angle), 0.0))

        if turn >= t1 or displacement(self.exit_angle) >= 0:
            return np.empty(0)
        return np.array([brentq(displacement, self.exit_angle, turn, xtol=ROOT_XTOL, rtol=ROOT_RTOL)])

    def _integrate(self, start: float, end: float, count: int) -> Array:
        """Integrate over a piece [rad] in either order by a number of intervals, graded at the start."""
        edges = np.linspace(0, 1, count + 1)
        u = (edges[:-1, None] + (NODES + 1) / 2 / count).ravel()
        weight = np.tile(WEIGHTS / 2 / count, count) * GRADING * u ** (GRADING - 1) * abs(end - start)
        angle = start + (end - start) * u**GRADING
        sigma, tau = self.stresses(angle)
        sine, cosine = np.sin(angle), np.cos(angle)
        rows = (
            sigma * cosine + tau * sine,
            tau * cosine - sigma * sine,
            self.radius * tau,
            np.where(angle > 0, sigma * sine, 0.0),
        )
        return self.radius * np.array([row @ weight for row in rows])


def roll_wheel(
    layer: rolling_contact.Layer,
    roller: rolling_contact.Roller,
    terrain: Terrain,
    speed: float,
    *,
    slip: float | None = None,
    torque: float | None = None,
) -> WheelContactResult:
    """Compute a rigid wheel that rolls over terrain.

    Parameters
    ----------
    layer : Layer
        Layer; its height counts for laws over the density ratio alone.
    roller : Roller
        Wheel with a prescribed indentation (sinkage), load or peak pressure, per unit width. The circle is its profile
        in every case, and the `friction` that of the shear strength of the terrain.
    terrain : Terrain
        Laws of pressure and shear.
    speed : float
        Speed along x [m/s], not 0; it enters by its sign.
    slip : float, optional
        Prescribed slip [-], -1 < s < 1: driven above 0, braked or towed below. Without slip and torque, a wheel on
        terrain with shear strength is free of torque.
    torque : float, optional
        Prescribed torque in the sense of rolling [N].

    Returns
    -------
    WheelContactResult

    Raises
    ------
    ValueError
        If the terrain cannot bear the load, or no slip has the torque.

    Examples
    --------
    >>> from compact.material.pressure_sinkage import ShearStrength, Terrain, bekker
    >>> from compact.rolling_contact import Layer, Roller
    >>> soil = Terrain(bekker(990.0, 1.52843e6, 1.1, width=0.15), ShearStrength(1040.0, 28.0, 0.02))
    >>> wheel = roll_wheel(Layer(1.0), Roller(0.25, load=500 / 0.15), soil, speed=0.1, slip=0.2)
    >>> f"sinkage {wheel.indentation * 1e3:.1f} mm, drawbar {wheel.drawbar * 0.15:.0f} N"
    'sinkage 34.4 mm, drawbar 77 N'
    """
    rolling_contact.require_moving(speed)
    _require_wheel(layer, roller, terrain, slip, torque)

    def build(entry_angle: float, slip: float) -> WheelContact:
        return WheelContact(terrain, float(roller.radius), float(layer.height), entry_angle, slip)

    if terrain.shear is None:
        found = _on_target(build, roller, 0.0)
    elif slip is not None:
        found = _on_target(build, roller, float(slip))
    else:
        found = _slip_of_torque(build, roller, float(torque or 0.0))
    return _build_result(found, roller, float(np.sign(speed)))


Build = Callable[[float, float], WheelContact]


def _on_target(build: Build, roller: rolling_contact.Roller, slip: float) -> WheelContact:
    """Find the entry angle of the prescribed quantity at a slip."""
    name, value = roller.target
    if name == "indentation":
        require_that(value < roller.radius, value, f"`indentation` must be below the radius {roller.radius!r} m, got")
        return build(2 * float(np.arcsin(np.sqrt(value / (2 * roller.radius)))), slip)

    def excess(angle: float) -> float:
        contact = build(angle, slip)
        if contact.sinkage >= contact.height:
            return np.inf
        if name == "peak_pressure":
            reached = float(contact.stresses(np.array([contact.peak_angle]))[0][0])
        else:
            reached = contact.forces().load
        return np.inf if np.isnan(reached) else reached - value  # beyond a table

    least = ANGLE_MIN
    if build(ANGLE_MAX, slip).peak_angle and slip < 0:  # the contact reaches beyond the change of the shear stress
        least = build(ANGLE_MAX, slip).peak_angle * (1 + PEAK_MARGIN)
    high = _bearing_angle(excess, least)
    low = least if excess(least) < 0 else 0.0
    if not low:
        raise ValueError(f"`{name}` must exceed {excess(least) + value:.3g} at this slip, got {value!r}")
    return build(float(brentq(excess, low, high, xtol=ANGLE_XTOL, rtol=ROOT_RTOL)), slip)


def _bearing_angle(excess: Callable[[float], float], least: float) -> float:
    """Return an entry angle [rad] at which the prescribed quantity is exceeded by a finite amount."""
    low, high = least, least
    for angle in np.linspace(least, ANGLE_MAX, TRIAL_ANGLES + 1)[1:].tolist():
        value = excess(angle)
        if 0 <= value < np.inf:
            return angle
        if value == np.inf:
            high = angle
            break
        low = angle
    for _ in range(BISECTIONS):  # the last finite angle, between `low` and `high`
        middle = (low + high) / 2
        value = excess(middle)
        if 0 <= value < np.inf:
            return middle
        low, high = (middle, high) if value < 0 else (low, middle)
    raise ValueError(
        f"the terrain does not bear the wheel: the prescribed quantity is missed by {-excess(low):.4g} at the largest "
        f"entry angle of {np.degrees(low):.3g} degrees; reduce it, or extend the table of the law"
    )


def _slip_of_torque(build: Build, roller: rolling_contact.Roller, torque: float) -> WheelContact:
    """Find the slip at which the torque [N] has its prescribed value."""

    def excess(slip: float) -> float:
        return _on_target(build, roller, slip).forces().torque - torque

    at_rest = excess(0.0)
    sign = -1.0 if at_rest > 0 else 1.0
    before, reached = 0.0, at_rest
    for slip in (sign * np.array(SLIP_STEPS)).tolist():
        try:
            reached = excess(slip)
        except ValueError:  # the largest stress would leave the contact
            break
        if reached * at_rest <= 0:
            low, high = sorted((before, slip))
            found = float(brentq(excess, low, high, xtol=ROOT_XTOL, rtol=ROOT_RTOL)) if at_rest else 0.0
            return _on_target(build, roller, found)
        before = slip
    low, high = sorted((at_rest + torque, reached + torque))
    raise ValueError(
        f"`torque` must lie between {low:.4g} and {high:.4g} N, as slips to {before:g} have on this terrain, got "
        f"{torque!r}"
    )


def _build_result(contact: WheelContact, roller: rolling_contact.Roller, direction: float) -> WheelContactResult:
    """Express a contact in the fixed axis x, with the largest normal stress and the error of the integrals."""
    forces = contact.forces()
    if contact.sinkage >= contact.height:
        raise ValueError(f"the sinkage of {contact.sinkage:.4g} m must be below the layer height {contact.height!r} m")
    t1, t2, peak = contact.entry_angle, contact.exit_angle, contact.peak_angle
    share = (1 - np.cos(np.linspace(0, np.pi, SAMPLES))) / 2
    angle = np.unique(np.append(t2 + (t1 - t2) * share, peak))
    sigma, tau = contact.stresses(angle)
    rise = 2 * contact.radius * np.sin(t2 / 2) ** 2
    ascending = slice(None, None, int(direction))
    scale = rolling_contact.resistance_scale(forces.drawbar, forces.load)
    found = WheelContactResult(
        load=forces.load,
        resistance=-direction * forces.drawbar,
        leading=float(contact.radius * np.sin(t1)),
        trailing=float(contact.radius * np.sin(t2)),
        x=(direction * contact.radius * np.sin(angle))[ascending],
        pressure=sigma[ascending],
        shear_traction=(-direction * tau)[ascending],
        error=(forces.error, forces.error * max(forces.load, abs(forces.drawbar)) / scale),
        peak_pressure=float(sigma[np.searchsorted(angle, peak)]),
        indentation=float(contact.sinkage),
        entry_angle=float(t1),
        exit_angle=float(t2),
        peak_angle=float(peak),
        slip=np.nan if contact.terrain.shear is None else contact.slip,
        drawbar=forces.drawbar,
        torque=forces.torque,
        compaction_resistance=forces.work,
        exit_height=float(contact.height - contact.sinkage + rise),
    )
    rolling_contact.require_on_target(found, roller, TARGET_RTOL)
    return found


def parabola_sinkage(law: PowerSinkage, radius: float, load: float) -> float:
    """Compute the sinkage [m] of a wheel without shear whose circle is replaced by a parabola.

        z0 = [2 P Gamma(n + 3/2)/(k sqrt(2 R) Gamma(n + 1) sqrt(pi))]^(2/(2 n + 1))

    Parameters
    ----------
    law : PowerSinkage
        Pressure over sinkage.
    radius : float
        Radius of the wheel [m].
    load : float
        Load per unit width P [N/m].

    Returns
    -------
    float
        Sinkage z0 [m].
    """
    n = law.exponent
    ratio = 2 * load * gamma(n + 1.5) / (law.modulus * np.sqrt(2 * radius * np.pi) * gamma(n + 1))
    return float(ratio ** (2 / (2 * n + 1)))


def textbook_wheel(law: PowerSinkage, radius: float, load: float) -> tuple[float, float]:
    """Compute sinkage [m] and compaction resistance [N/m] by the closed forms of Bekker's textbook.

        z0 = [3 P/(k sqrt(D) (3 - n))]^(2/(2 n + 1)),   R_c = k z0^(n + 1)/(n + 1),   D = 2 R

    The forms expand the circle for small n. Both errors reach 10 % at the usual sinkages.

    Parameters
    ----------
    law : PowerSinkage
        Pressure over sinkage, n < 3.
    radius : float
        Radius of the wheel [m].
    load : float
        Load per unit width P [N/m].

    Returns
    -------
    sinkage, resistance : float
        z0 [m] and R_c [N/m].
    """
    n = law.exponent
    sinkage = float((3 * load / (law.modulus * np.sqrt(2 * radius) * (3 - n))) ** (2 / (2 * n + 1)))
    return sinkage, law.modulus * sinkage ** (n + 1) / (n + 1)


def _require_wheel(
    layer: rolling_contact.Layer, roller: rolling_contact.Roller, terrain: Any, slip: float | None, torque: float | None
) -> None:
    """Require a layer, wheel and state of motion in the range of the model."""
    if layer.plies or layer.lower_lift is not None:
        raise ValueError("terrain must be one layer, got `plies` or a `lower_lift`; give its law over the sinkage")
    require_known("rolling", roller.rolling, ("frictionless", "free", "driven"))
    if terrain.shear is None and (slip is not None or torque):
        raise ValueError(
            f"a terrain without `shear` carries no slip or torque, got {slip!r} and {torque!r}; give a shear strength"
        )
    if slip is not None and torque is not None:
        raise ValueError(f"give `slip` or `torque`, not both, got {slip!r} and {torque!r}")
    if slip is not None:
        require_that(abs(slip) < 1, slip, "`slip` must lie between -1 and 1, got")
