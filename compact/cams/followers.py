"""Followers of a cam: how a point, a roller or a flat face meets the profile.

rho, rho', rho'' are what the follower follows and its derivatives by the cam's angle phi; a follower knows the contact
point, how fast the profile turns (`turn`, by phi) and how long it grows (`arc`, by phi), and how far the law must be
raised so that no part of the profile runs backwards. Lengths in m, angles in rad.
"""

from dataclasses import dataclass

import numpy as np

from compact.numerics.piecewise import BREAK_OFFSET
from compact.numerics.validation import require_positive

NEWTON_STEPS = 100  # 10-25 are taken; a double root takes 50; the result is right to rounding


@dataclass(frozen=True)
class _OnRadius:
    """A point or a roller that moves along a line through the axis; its centre draws the polar pitch curve rho(phi).

        w^2 = rho^2 + rho'^2,  turn = (rho^2 + 2 rho'^2 - rho rho'')/w^2,  arc = w - r turn

    The profile is the pitch curve offset inwards by the roller's radius r along its normal (rho, -rho')/w.
    """

    radius: float

    def contact(self, rho, slope):
        """Contact point (radial, offset) [m]."""
        w = np.hypot(rho, slope)
        return rho - self.radius * rho / w, self.radius * slope / w

    def rates(self, rho, slope, second):
        """Turn [-] and arc [m] of the profile by phi."""
        w = np.hypot(rho, slope)
        turn = 1 + (slope**2 - rho * second) / w**2
        return turn, w - self.radius * turn

    def pressure_angle(self, rho, slope):
        """Angle [rad] between the follower's travel and the common normal: tan = rho'/rho."""
        return np.arctan2(slope, rho)

    @property
    def radius_at_kink(self):
        """Radius of curvature [m] that a downward jump of rho' leaves: the corner of the pitch curve, offset by r."""
        return -self.radius

    def base_radius(self, x, slope, second):
        """Least (b - stroke)/2 [m] above which the profile does not run backwards where the travel is x, x', x''.

            g(rho) = w^3 - r (rho^2 + 2 rho'^2 - rho rho'') = 0,  its largest root with rho >= r, minus x

        g is convex for rho >= r and positive from 4r/3 + |rho''| on, so Newton's method falls monotonically from
        there on the largest root; where it passes all, there is none and rho = r, the axis on the profile.
        """
        r, rho = self.radius, 4 * self.radius / 3 + np.abs(second)
        for _ in range(NEWTON_STEPS):
            w = np.hypot(rho, slope)
            g = w**3 - r * (w**2 + slope**2 - rho * second)
            rise = 3 * rho * w - r * (2 * rho - second)
            step = np.divide(g, rise, out=np.full_like(rho, np.inf), where=rise > 0)
            lower = np.maximum(rho - step, r)
            if np.all(np.abs(lower - rho) <= 4 * BREAK_OFFSET * rho):
                break
            rho = lower
        return rho - x


@dataclass(frozen=True)
class Pointed(_OnRadius):
    """A knife edge: the profile is the polar curve rho(phi) itself, corners where the velocity jumps included."""

    radius: float = 0.0

    def __post_init__(self):
        if self.radius != 0:
            raise ValueError(f"a pointed follower has `radius` 0, got {self.radius!r}; take RollerFollower")

    def base_radius(self, x, slope, second):
        """Least (b - stroke)/2 [m]: any does, as long as rho > 0."""
        return -x


@dataclass(frozen=True)
class RollerFollower(_OnRadius):
    """A roller of `radius` r [m] > 0, in line with the axis."""

    def __post_init__(self):
        require_positive(radius=self.radius)

    def flanks_cross(self, angle, rho, slope):
        """Whether a point of the profile is nearer than r to another part of the pitch curve, on dense samples.

        It cannot be where rho^2/w > r all round: the profile is then seen whole from the axis.
        """
        if np.min(rho**2 / np.hypot(rho, slope)) > self.radius:
            return False
        from scipy.spatial import cKDTree

        turn = np.exp(1j * angle)
        radial, offset = self.contact(rho, slope)
        pitch, profile = (points.view(float).reshape(-1, 2) for points in (rho * turn, (radial + 1j * offset) * turn))
        rounding = 1e-9 * self.radius + 1e-12 * np.max(rho)
        return bool(cKDTree(pitch).query(profile)[0].min() < self.radius - rounding)


@dataclass(frozen=True)
class FlatFace:
    """A flat face square to its travel: the law is the support function of the profile.

    (x, y) = (rho cos - rho' sin, rho sin + rho' cos),  turn = 1,  arc = rho + rho''
    """

    radius_at_kink = -np.inf

    def contact(self, rho, slope):
        """Contact point (radial, offset) [m]: the face must reach |rho'| to either side."""
        return rho, slope

    def rates(self, rho, slope, second):
        """Turn [-] and arc [m] of the profile by phi."""
        return np.ones(np.shape(rho)), rho + second

    def pressure_angle(self, rho, slope):
        """Zero everywhere: the normal of the face is the travel."""
        return np.zeros(np.shape(rho))

    def base_radius(self, x, slope, second):
        """Least (b - stroke)/2 [m] that keeps rho + rho'' >= 0 and rho >= 0."""
        return np.maximum(-x - second, 0.0)
