"""The torque of a motor over its speed: anything with `torque(speed)` and `no_load_speed` turns a shaft (`motor`).

A flat belt between a motor and the gear of its shaft: it stretches under its pull, and so it creeps.

    w_g = w (1 - T/C),  C = r E A;   |T| <= 2 r F0 (e^(mu alpha) - 1)/(e^(mu alpha) + 1)

w is the speed of the motor, w_g that which the radii of the pulleys alone would give it, T the torque on the motor's
pulley of radius r: the tensions of the two runs differ by T/r, and their sum stays twice the preload F0. The belt comes
on each pulley with the stretch of one run and leaves it with that of the other; as much of it passes everywhere, so
that its speeds are as 1 + strain (to first order). No torque is lost, but the power T (w - w_g). Beyond the limit of
Eytelwein, friction mu over the angle of wrap alpha, the belt slips. Its mass is left out, and the time of its stretch.

References
----------
J. A. Eytelwein, Handbuch der Statik fester Koerper, Berlin 1808. O. Reynolds, The Engineer 38 (1874) 396: creep.
"""

import math
from dataclasses import dataclass

import numpy as np

from compact.numerics.validation import require_positive


@dataclass(frozen=True)
class LinearTorqueCurve:
    """A motor whose torque falls straight with its speed (direct current): T = stall_torque (1 - w/no_load_speed).

    stall_torque [N m]; no_load_speed [rad/s]
    """

    stall_torque: float
    no_load_speed: float

    def __post_init__(self):
        require_positive(stall_torque=self.stall_torque, no_load_speed=self.no_load_speed)

    def torque(self, speed):
        """T [N m] at the motor's speed [rad/s]."""
        return self.stall_torque * (1 - speed / self.no_load_speed)


@dataclass(frozen=True)
class Kloss:
    """An induction motor by Kloss' formula: T = 2 T_b/(s/s_b + s_b/s), s = 1 - w/w_s.

    breakdown_torque : T_b [N m];  breakdown_slip : s_b;  synchronous_speed : w_s [rad/s]

    Stator resistance neglected: M. Kloss, Archiv fuer Elektrotechnik 5 (1916) 59.

    >>> f"{Kloss(50.0, 0.2, 157.0).torque(0.8 * 157.0):.1f} N m"
    '50.0 N m'
    """

    breakdown_torque: float
    breakdown_slip: float
    synchronous_speed: float

    def __post_init__(self):
        require_positive(
            breakdown_torque=self.breakdown_torque,
            breakdown_slip=self.breakdown_slip,
            synchronous_speed=self.synchronous_speed,
        )

    @property
    def no_load_speed(self):
        """w_s [rad/s]."""
        return self.synchronous_speed

    def torque(self, speed):
        """T [N m] at the motor's speed [rad/s]; it brakes above w_s."""
        slip = 1 - speed / self.synchronous_speed
        return 2 * self.breakdown_torque * slip * self.breakdown_slip / (slip**2 + self.breakdown_slip**2)


LARGEST_CREEP = 0.1  # that friction can hold: beyond, first order in the strain is too little
ITERATIONS = 50  # of Newton's method; 3 to 5 are usual
CHANGE = 1e-14  # of the speed, at which these end
PROBE = 1e-7  # relative difference for the derivative


@dataclass(frozen=True)
class Belt:
    """A belt.

    pulley_radius : r of the motor's pulley [m];  stiffness : E A of the belt, force over strain [N]
    preload : F0, tension of both runs at rest [N];  friction : mu;  wrap : alpha of the smaller pulley [rad]

    >>> belt = Belt(pulley_radius=0.1, stiffness=50e3, preload=500.0, friction=0.4, wrap=3.0)
    >>> f"holds {belt.holds:.1f} N m, creeps {belt.holds / belt.creep_torque:.2%} then"
    'holds 53.7 N m, creeps 1.07% then'
    """

    pulley_radius: float
    stiffness: float
    preload: float
    friction: float
    wrap: float

    def __post_init__(self):
        require_positive(
            pulley_radius=self.pulley_radius,
            stiffness=self.stiffness,
            preload=self.preload,
            friction=self.friction,
            wrap=self.wrap,
        )
        if self.holds > LARGEST_CREEP * self.creep_torque:
            raise ValueError(
                f"`stiffness` {self.stiffness:g} N is too soft for the `preload` {self.preload:g} N: the belt would "
                f"creep by {self.holds / self.creep_torque:.2g} before it slips, at most {LARGEST_CREEP:g} is allowed"
            )

    @property
    def creep_torque(self):
        """C [N m]: T/C is the creep."""
        return self.pulley_radius * self.stiffness

    @property
    def holds(self):
        """Largest |T| on the motor's pulley that does not slip [N m]."""
        return 2 * self.pulley_radius * self.preload * math.tanh(self.friction * self.wrap / 2)

    def needed_preload(self, torque):
        """Least F0 [N] that holds a torque [N m]."""
        return abs(torque) / (2 * self.pulley_radius * math.tanh(self.friction * self.wrap / 2))

    def motor_speed(self, pull, speed):
        """w [rad/s] of a motor that puts `pull`(w) [N m] on the belt, where the gear asks for the speed w_g [rad/s].

            w (1 - pull(w)/C) = w_g

        RuntimeError where Newton's method finds none: the motor's power would rise faster with its speed than C.
        """
        C, asked = self.creep_torque, np.asarray(speed, float)
        w, step = asked, PROBE * (np.abs(asked) + np.abs(asked).max())
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            for _ in range(ITERATIONS):
                left = w * (1 - pull(w) / C) - asked
                slope = (w + step) * (1 - pull(w + step) / C) - asked - left
                change = np.where(left == 0, 0.0, -left * step / slope)
                w = w + change
                if np.all(np.abs(change) <= CHANGE * np.abs(w).max()) and np.all(np.isfinite(w)):
                    return w
        raise RuntimeError(
            f"no speed of the motor found with its belt, {np.abs(change).max():g} rad/s are left; the belt is too soft"
        )
