"""Curvature of the pitch curve of a roller follower, as a constraint on the motion law.

    rho = b/2 +- (x - stroke/2),  rho' = +- q x',  rho'' = +- q^2 x'',  q = period/(2 pi),  + forward and - return
    kappa = (rho^2 + 2 rho'^2 - rho rho'')/w^3,  w^2 = rho^2 + rho'^2

The cam profile is the pitch curve offset inwards by the roller radius r: its radius of curvature is 1/kappa - r where
it is convex and 1/|kappa| + r where it is concave (`compact.cams`). Both are at least R, without undercut, where

    kappa (r + R) <= 1   and   kappa (r - R) <= 1

at every angle, the near dwell included. The left-hand sides are the `curvature_ratios`. The constraint is not linear in
the unknowns of a spline; sequential convex programming linearises it.
"""

from dataclasses import dataclass

import numpy as np

from compact.motion.objectives import Linearisation, QuadratureNodes
from compact.numerics import Array

CURVATURE_MARGIN = 2e-5  # [-], of the curvature ratio: reserve for peaks between the nodes, twice their usual excess


@dataclass(frozen=True)
class PitchCurve:
    """Path of the centre of a roller on a cam of constant breadth.

    Attributes
    ----------
    breadth, stroke, roller_radius : float
        Breadth b of the cam, travel of one pass, and roller radius r [m].
    profile_radius : float
        Smallest allowed radius of curvature R of the profile [m].
    seconds_per_radian : float
        Period over 2 pi, q [s/rad].
    dwells : bool
        True if the cart dwells at the ends.
    """

    breadth: float
    stroke: float
    roller_radius: float
    profile_radius: float
    seconds_per_radian: float
    dwells: bool

    @property
    def crossing_angle(self) -> float:
        """Pressure angle [rad] below which the flanks of the profile cannot cross: rho^2/w = rho cos(angle) >= r."""
        return float(np.arccos(2 * self.roller_radius / (self.breadth - self.stroke)))

    def curvature(self, x: Array, v: Array, a: Array) -> Array:
        """Return kappa [1/m] of both strokes, shape (2, n), at x [m], v [m/s] and a [m/s^2]."""
        rho, slope, second, _ = self._polar(x, v, a)
        w = np.hypot(rho, slope)
        return (w**2 + slope**2 - rho * second) / w**3

    def curvature_ratios(self, x: Array, v: Array, a: Array) -> Array:
        """Return kappa (r + R) and kappa (r - R) [-] of both strokes and a dwell, shape (4 or 5, n); all at most 1."""
        ratios = (self._spans * self.curvature(x, v, a)).reshape(4, -1)
        near = (self.breadth - self.stroke) / 2
        return np.vstack([ratios, np.full(len(x), self._spans.max() / near)]) if self.dwells else ratios

    def nodal_ratios(self, nodes: QuadratureNodes, unknowns: Array) -> Array:
        """Return the `curvature_ratios` [-] of a law with coefficients [-] at its nodes."""
        return self.curvature_ratios(*_travel(nodes, unknowns))

    def reached_radius(self, nodes: QuadratureNodes, unknowns: Array) -> float:
        """Return the largest R [m] that the profile of a law satisfies with the `CURVATURE_MARGIN`."""
        kappa = self.curvature(*_travel(nodes, unknowns))
        near, room = (self.breadth - self.stroke) / 2, 1 - CURVATURE_MARGIN
        convex, concave = max(kappa.max(), 1 / near if self.dwells else -np.inf), -kappa.min()
        of_concave = room / concave + self.roller_radius if concave > 0 else np.inf
        return float(min(room / convex - self.roller_radius, of_concave))

    def linearise(self, nodes: QuadratureNodes, unknowns: Array) -> Linearisation:
        """Return the `Linearisation` of the largest curvature ratio."""
        x, v, a = _travel(nodes, unknowns)
        rho, slope, second, sign = self._polar(x, v, a)
        w = np.hypot(rho, slope)
        top, q = w**2 + slope**2 - rho * second, self.seconds_per_radian
        by_position = sign * ((2 * rho - second) / w**3 - 3 * rho * top / w**5)
        by_velocity = sign * q * (4 * slope / w**3 - 3 * slope * top / w**5)
        by_acceleration = sign * q**2 * -rho / w**3
        parts = zip((by_position, by_velocity, by_acceleration), nodes[:3], strict=True)
        rows = (self._spans[..., None] * sum(part[..., None] * along for part, along in parts)).reshape(
            -1, len(unknowns)
        )
        values = self.curvature_ratios(x, v, a).ravel()
        return Linearisation(values, np.vstack([rows, np.zeros((len(values) - len(rows), len(unknowns)))]))

    def linearise_violation(self, nodes: QuadratureNodes, unknowns: Array) -> Linearisation:
        """Return the `Linearisation` of the largest excess of a curvature ratio over 1 - `CURVATURE_MARGIN`, or 0."""
        ratio = self.linearise(nodes, unknowns)
        values = np.append(ratio.values - (1 - CURVATURE_MARGIN), 0.0)
        return Linearisation(values, np.vstack([ratio.gradients, np.zeros(len(unknowns))]))

    @property
    def _spans(self):
        """Sum and difference of roller radius and profile radius [m], shape (2, 1, 1)."""
        r, R = self.roller_radius, self.profile_radius
        return np.array([r + R, r - R])[:, None, None]

    def _polar(self, x, v, a):
        """Return rho, rho', rho'' of both strokes, each of shape (2, n), and the sign of each stroke."""
        sign, q = np.array([[1.0], [-1.0]]), self.seconds_per_radian
        return self.breadth / 2 + sign * (x - self.stroke / 2), sign * q * v, sign * q**2 * a, sign


def _travel(nodes, unknowns):
    """Return x, v and a of a law at its nodes."""
    return tuple(rows @ unknowns for rows in nodes[:3])
