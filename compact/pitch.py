"""How curved the cam of a roller may be: what its motion law must keep so that the profile is cut as it is drawn.

    rho = b/2 +- (x - stroke/2),  rho' = +- q x',  rho'' = +- q^2 x'',  q = period/(2 pi),  + there and - back
    kappa = (rho^2 + 2 rho'^2 - rho rho'')/w^3,  w^2 = rho^2 + rho'^2        of the path of the roller's centre

The profile lies a roller's radius r inside that path: its radius of curvature is 1/kappa - r where it is convex and
1/|kappa| + r in a hollow (`cam`). Both are at least R, and nothing is undercut, where

    kappa (r + R) <= 1   and   kappa (r - R) <= 1

at every angle, standing at the near end among them. The larger of the two is the `crowding`.
"""

from dataclasses import dataclass

import numpy as np

from compact.criteria import Tangent

MARGIN = 2e-5  # of the crowding, kept free for peaks between the nodes: twice what these may be higher


@dataclass(frozen=True)
class Pitch:
    """The path of a roller's centre on a cam of constant `breadth` [m] that makes a law of a `stroke` [m].

    roller_radius : r [m];  profile_radius : R, the least radius of curvature of the profile [m]
    seconds : q, time in which the cam turns by one radian [s];  stands : whether the cart stands at the ends
    """

    breadth: float
    stroke: float
    roller_radius: float
    profile_radius: float
    seconds: float
    stands: bool

    @property
    def _spans(self):
        """r + R and r - R, shape (2, 1, 1)."""
        r, R = self.roller_radius, self.profile_radius
        return np.array([r + R, r - R])[:, None, None]

    def _ways(self, x, v, a):
        """rho, rho', rho'' there and back, each of shape (2, n), and the sign of the way."""
        sign, q = np.array([[1.0], [-1.0]]), self.seconds
        return self.breadth / 2 + sign * (x - self.stroke / 2), sign * q * v, sign * q**2 * a, sign

    def curvature(self, x, v, a):
        """kappa [1/m] there and back, shape (2, n), where the travel is x [m], x' = v, x'' = a."""
        rho, slope, second, _ = self._ways(x, v, a)
        w = np.hypot(rho, slope)
        return (w**2 + slope**2 - rho * second) / w**3

    def crowding(self, x, v, a):
        """kappa (r + R) and kappa (r - R) there and back, rows of shape (4 or 5, n); none may exceed 1."""
        found = (self._spans * self.curvature(x, v, a)).reshape(4, -1)
        near = (self.breadth - self.stroke) / 2
        return np.vstack([found, np.full(len(x), self._spans.max() / near)]) if self.stands else found

    def crowded(self, nodes, unknowns):
        """The `crowding` of a law at its nodes."""
        return self.crowding(*(rows @ unknowns for rows in (nodes.place, nodes.speed, nodes.change)))

    def reached(self, nodes, unknowns):
        """Largest R [m] that a law keeps with the `MARGIN`, convex or hollow."""
        kappa = self.curvature(*(rows @ unknowns for rows in (nodes.place, nodes.speed, nodes.change)))
        near, room = (self.breadth - self.stroke) / 2, 1 - MARGIN
        convex, hollow = max(kappa.max(), 1 / near if self.stands else -np.inf), -kappa.min()
        return float(
            min(room / convex - self.roller_radius, room / hollow + self.roller_radius if hollow > 0 else np.inf)
        )

    def tangent(self, nodes, unknowns):
        """`Tangent` of the largest crowding."""
        x, v, a = (rows @ unknowns for rows in (nodes.place, nodes.speed, nodes.change))
        rho, slope, second, sign = self._ways(x, v, a)
        w = np.hypot(rho, slope)
        top, q = w**2 + slope**2 - rho * second, self.seconds
        by_place = sign * ((2 * rho - second) / w**3 - 3 * rho * top / w**5)
        by_speed = sign * q * (4 * slope / w**3 - 3 * slope * top / w**5)
        by_change = sign * q**2 * -rho / w**3
        parts = zip((by_place, by_speed, by_change), (nodes.place, nodes.speed, nodes.change), strict=True)
        rows = (self._spans[..., None] * sum(part[..., None] * along for part, along in parts)).reshape(
            -1, len(unknowns)
        )
        values = self.crowding(x, v, a).ravel()
        return Tangent(values, np.vstack([rows, np.zeros((len(values) - len(rows), len(unknowns)))]))

    def excess(self, nodes, unknowns):
        """`Tangent` of what the crowding is above 1, less a `MARGIN`; 0 where it is below."""
        near = self.tangent(nodes, unknowns)
        values, rows = np.append(near.values - (1 - MARGIN), 0.0), np.vstack([near.rows, np.zeros(len(unknowns))])
        return Tangent(values, rows)
