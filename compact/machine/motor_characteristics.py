"""Torque curves of motors over their speed, and a flat belt with creep between motor and gear.

Any object with `torque(speed)` and `no_load_speed` is a torque curve. The belt stretches under its tension and
therefore creeps:

    w_g = w (1 - T/C),   C = r E A,   |T| <= 2 r F0 (e^(mu alpha) - 1)/(e^(mu alpha) + 1)

w is the speed of the motor, w_g its speed without creep, T the torque on the motor pulley of radius r. The tensions of
the two strands differ by T/r, and their sum remains twice the preload F0. The belt enters each pulley with the strain
of one strand and leaves it with that of the other; the mass flow is equal, so the speeds are in the ratio of
1 + strain, to first order. The torque is conserved and the power T (w - w_g) is lost. Beyond Eytelwein's limit, with
friction mu over the angle of wrap alpha, the belt slips. Mass and transient strain of the belt are neglected.

References
----------
J. A. Eytelwein, Handbuch der Statik fester Koerper, Berlin 1808. O. Reynolds, The Engineer 38 (1874) 396: creep.
M. Kloss, Archiv fuer Elektrotechnik 5 (1916) 59: induction motor.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from compact.numerics import Array
from compact.numerics.validation import require_positive

MAX_BELT_CREEP = 0.1  # [-], at the slip limit; the first order in the strain is not sufficient beyond
BELT_ITERATIONS = 50  # [-], of Newton's method; 3 to 5 are usual
SPEED_TOLERANCE = 1e-14  # [-], of the largest speed; change at convergence
SPEED_PERTURBATION = 1e-7  # [-], relative; finite difference of the torque


class TorqueCurve(Protocol):
    """Torque of a motor over its speed."""

    @property
    def no_load_speed(self) -> float:
        """Speed without load [rad/s]."""

    def torque(self, speed: Array) -> Array:
        """Return the torque [N m] at speeds [rad/s]."""


@dataclass(frozen=True)
class LinearTorqueCurve:
    """Direct-current motor: T = stall_torque (1 - w/no_load_speed).

    Parameters
    ----------
    stall_torque : float
        Torque at rest [N m].
    no_load_speed : float
        Speed without load [rad/s].
    """

    stall_torque: float
    no_load_speed: float

    def __post_init__(self) -> None:
        require_positive(**vars(self))

    def torque(self, speed: Array) -> Array:
        """Return T [N m] at speeds of the motor [rad/s]."""
        return self.stall_torque * (1 - speed / self.no_load_speed)


@dataclass(frozen=True)
class Kloss:
    """Induction motor by the formula of Kloss, without stator resistance: T = 2 T_b/(s/s_b + s_b/s), s = 1 - w/w_s.

    Parameters
    ----------
    breakdown_torque : float
        T_b [N m].
    breakdown_slip : float
        s_b [-].
    synchronous_speed : float
        w_s [rad/s].

    Examples
    --------
    >>> f"{Kloss(50.0, 0.2, 157.0).torque(0.8 * 157.0):.1f} N m"
    '50.0 N m'
    """

    breakdown_torque: float
    breakdown_slip: float
    synchronous_speed: float

    def __post_init__(self) -> None:
        require_positive(**vars(self))

    @property
    def no_load_speed(self) -> float:
        """Synchronous speed w_s [rad/s]."""
        return self.synchronous_speed

    def torque(self, speed: Array) -> Array:
        """Return T [N m] at speeds of the motor [rad/s], negative above w_s."""
        slip = 1 - speed / self.synchronous_speed
        return 2 * self.breakdown_torque * slip * self.breakdown_slip / (slip**2 + self.breakdown_slip**2)


@dataclass(frozen=True)
class Belt:
    """Flat belt.

    Parameters
    ----------
    pulley_radius : float
        r of the motor pulley [m].
    stiffness, preload : float
        E A, force over strain, and F0, tension of both strands at rest [N].
    friction, wrap : float
        mu [-] and alpha of the smaller pulley [rad].

    Examples
    --------
    >>> belt = Belt(pulley_radius=0.1, stiffness=50e3, preload=500.0, friction=0.4, wrap=3.0)
    >>> f"slips beyond {belt.slip_torque:.1f} N m, with a creep of {belt.slip_torque / belt.creep_torque:.2%}"
    'slips beyond 53.7 N m, with a creep of 1.07%'
    """

    pulley_radius: float
    stiffness: float
    preload: float
    friction: float
    wrap: float

    def __post_init__(self) -> None:
        require_positive(**vars(self))
        creep = self.slip_torque / self.creep_torque
        if creep > MAX_BELT_CREEP:
            raise ValueError(
                f"`stiffness` {self.stiffness:g} N is too low for the `preload` {self.preload:g} N: the belt would "
                f"creep by {creep:.2g} before it slips, allowed are {MAX_BELT_CREEP:g}; use a stiffer belt"
            )

    @property
    def creep_torque(self) -> float:
        """Torque C for a creep of 1 [N m]; the creep is T/C."""
        return self.pulley_radius * self.stiffness

    @property
    def slip_torque(self) -> float:
        """Largest |T| on the motor pulley without slip [N m]."""
        return 2 * self.pulley_radius * self.preload * math.tanh(self.friction * self.wrap / 2)

    def required_preload(self, torque: float) -> float:
        """Smallest F0 [N] that transmits a torque [N m] without slip."""
        return abs(torque) / (2 * self.pulley_radius * math.tanh(self.friction * self.wrap / 2))

    def motor_speed(self, belt_torque: Callable[[Array], Array], speed: Array) -> Array:
        """Solve the speed w [rad/s] for the torque on the pulley [N m] over w and the speed w_g without creep.

        w (1 - belt_torque(w)/C) = w_g
        """
        C, geared = self.creep_torque, np.asarray(speed, float)
        w, step = geared, SPEED_PERTURBATION * (np.abs(geared) + np.abs(geared).max())
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            for _ in range(BELT_ITERATIONS):
                residual = w * (1 - belt_torque(w) / C) - geared
                slope = (w + step) * (1 - belt_torque(w + step) / C) - geared - residual
                change = np.where(residual == 0, 0.0, -residual * step / slope)
                w = w + change
                if np.all(np.abs(change) <= SPEED_TOLERANCE * np.abs(w).max()) and np.all(np.isfinite(w)):
                    return w
        raise RuntimeError(
            f"the speed of the motor behind its belt did not converge, last change {np.abs(change).max():g} rad/s; use "
            "a stiffer belt"
        )
