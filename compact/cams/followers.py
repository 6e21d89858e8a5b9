"""Followers of a cam: contact of a point, a roller or a flat face with the profile.

rho, rho', rho'' are the distance of the follower from the axis and its derivatives by the cam angle phi. A follower
computes the contact point, the rates by phi of the direction (`turn`) and of the length (`arc`) of the profile, and the
increase of rho required so that no part of the profile runs backwards. Lengths in m, angles in rad.
"""

from dataclasses import dataclass

import numpy as np

from compact.numerics import Array
from compact.numerics.validation import require_positive

NEWTON_TOLERANCE = 16 * np.finfo(float).eps  # [-], of rho: change of the last step
NEWTON_LIMIT = 100  # [-], steps to rounding: 10-25 are usual, a double root needs 50


@dataclass(frozen=True)
class _RadialFollower:
    """Point or roller on a line through the axis; its centre traces the pitch curve rho(phi).

        w^2 = rho^2 + rho'^2,  turn = (rho^2 + 2 rho'^2 - rho rho'')/w^2,  arc = w - r turn

    The profile is the pitch curve offset inwards by the roller radius r along its normal (rho, -rho')/w.
    """

    radius: float

    def contact(self, rho: Array, slope: Array) -> tuple[Array, Array]:
        """Return the contact point (radial, offset) [m] from rho and rho' [m]."""
        w = np.hypot(rho, slope)
        return rho - self.radius * rho / w, self.radius * slope / w

    def rates(self, rho: Array, slope: Array, second: Array) -> tuple[Array, Array]:
        """Return turn [-] and arc [m] of the profile by phi from rho, rho' and rho'' [m]."""
        w = np.hypot(rho, slope)
        turn = 1 + (slope**2 - rho * second) / w**2
        return turn, w - self.radius * turn

    def pressure_angle(self, rho: Array, slope: Array) -> Array:
        """Return the angle [rad] between travel and common normal from rho and rho' [m]: tan = rho'/rho."""
        return np.arctan2(slope, rho)

    @property
    def radius_at_kink(self) -> float:
        """Radius of curvature [m] at a downward jump of rho': a corner of the pitch curve, offset by r."""
        return -self.radius

    def base_radius(self, x: Array, slope: Array, second: Array) -> Array:
        """Return the smallest (b - stroke)/2 [m] whose profile does not run backwards.

            g(rho) = w^3 - r (rho^2 + 2 rho'^2 - rho rho'') = 0,  its largest root with rho >= r, minus x

        g is convex for rho >= r and positive from 4r/3 + |rho''| on, so that Newton's method descends monotonically
        from there to the largest root; without a root, rho = r and the axis lies on the profile.

        Parameters
        ----------
        x, slope, second : ndarray
            Travel and its derivatives by phi [m].
        """
        r, rho = self.radius, 4 * self.radius / 3 + np.abs(second)
        for _ in range(NEWTON_LIMIT):
            w = np.hypot(rho, slope)
            g = w**3 - r * (w**2 + slope**2 - rho * second)
            derivative = 3 * rho * w - r * (2 * rho - second)
            step = np.divide(g, derivative, out=np.full_like(rho, np.inf), where=derivative > 0)
            lower = np.maximum(rho - step, r)
            if np.all(np.abs(lower - rho) <= NEWTON_TOLERANCE * rho):
                break
            rho = lower
        return rho - x


@dataclass(frozen=True)
class Pointed(_RadialFollower):
    """Knife-edge follower: the profile is the pitch curve itself, corners at velocity jumps included.

    Attributes
    ----------
    radius : float
        0 [m].
    """

    radius: float = 0.0

    def __post_init__(self) -> None:
        if self.radius != 0:
            raise ValueError(f"a pointed follower has `radius` 0, got {self.radius!r}; use RollerFollower")

    def base_radius(self, x: Array, slope: Array, second: Array) -> Array:  # noqa: ARG002, protocol of followers
        """Return the smallest (b - stroke)/2 [m]: any value with rho > 0 is valid."""
        return -x


@dataclass(frozen=True)
class RollerFollower(_RadialFollower):
    """Roller follower on a line through the axis.

    Attributes
    ----------
    radius : float
        Roller radius r [m], > 0.
    """

    def __post_init__(self) -> None:
        require_positive(radius=self.radius)

    def flanks_cross(self, angle: Array, rho: Array, slope: Array) -> bool:
        """Return True if a point of the profile is nearer than r to another part of the pitch curve rho(angle) [m].

        This is excluded where rho^2/w > r all round: the whole profile is then visible from the axis.
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
    """Flat-faced follower at right angles to its travel: the law is the support function of the profile.

    (x, y) = (rho cos - rho' sin, rho sin + rho' cos),  turn = 1,  arc = rho + rho''
    """

    radius_at_kink = -np.inf

    def contact(self, rho: Array, slope: Array) -> tuple[Array, Array]:
        """Return the contact point (radial, offset) [m]: the face must extend to |rho'| on either side."""
        return rho, slope

    def rates(self, rho: Array, slope: Array, second: Array) -> tuple[Array, Array]:  # noqa: ARG002
        """Return turn [-] and arc [m] of the profile by phi from rho, rho' and rho'' [m]."""
        return np.ones(np.shape(rho)), rho + second

    def pressure_angle(self, rho: Array, slope: Array) -> Array:  # noqa: ARG002
        """Return zero [rad]: the normal of the face is the direction of travel."""
        return np.zeros(np.shape(rho))

    def base_radius(self, x: Array, slope: Array, second: Array) -> Array:  # noqa: ARG002
        """Return the smallest (b - stroke)/2 [m] with rho + rho'' >= 0 and rho >= 0."""
        return np.maximum(-x - second, 0.0)
