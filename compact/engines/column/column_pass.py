"""One pass of a roller over a bed of columns: from what the columns are to what they have become, with all the sums."""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from compact.engines.column.column_ode import (
    COLLAPSED,
    DRAG,
    ELASTIC,
    EVALUATIONS,
    LOGARITHMIC,
    MASS_TRUE,
    OWN,
    PAUSED,
    PLASTIC,
    PUSH,
    REACHED,
    ROW,
    SMALL,
    STRESS,
    TOO_MANY,
    TRIED,
    UNCUT,
    Profile,
    Stack,
    begun,
    settling,
    travel,
)
from compact.material.cap_plasticity import cap_constants, hardening
from compact.numerics.validation import require_finite, require_nonnegative, require_positive

LONGEST = 1 / 32  # share of the front that a step may take of a pass that is drawn, so that it has points
DEEPEST = 1 - 1e-9  # share of the limit of indentation up to which a pass is computed
FAR = 2.0  # indentations by which the layer may rise behind the roller
STIFFEST = 2e5  # settling of the stress that is integrated; a step of `confined.travel` takes 6 of it
STRAINS = {"logarithmic": LOGARITHMIC, "small": SMALL, "mass-true": MASS_TRUE}
PLATE = Profile(0.0, 0.0)
ROWS = 128  # of a path at first; room for all steps would cost more than most of them
SLICE = 20_000  # steps tried in one compiled call, over the number of columns: a tenth of a second or less
FAILURES = {
    TOO_MANY: "it would take more",
    COLLAPSED: "shorter steps do not move it",
    UNCUT: "the stress at which a column yields is not met",
}


@dataclass(frozen=True)
class Column:
    """Mix at rest between two passes: free of vertical stress, held sideways.

    height [m] > 0;  density_ratio : k, 0 < k < 1;  lateral_stress : s_h, compression positive [Pa]
    hardened : the k that pc remembers, where that is more than k
    """

    height: float
    density_ratio: float
    lateral_stress: float = 0.0
    hardened: float = 0.0

    def __post_init__(self):
        require_positive(height=self.height, density_ratio=self.density_ratio)
        require_finite(lateral_stress=self.lateral_stress)
        require_nonnegative(hardened=self.hardened)
        if not self.density_ratio < 1:
            raise ValueError(f"`density_ratio` must be below 1, got {self.density_ratio!r}")


@dataclass(frozen=True)
class Bed:
    """Columns before a roller, given from the base upwards; `law` of `cap.constants`, `measure` of `STRAINS`.

    Strain is ln(h0/h) if logarithmic, else (h0 - h)/h0; k = k0/(1 - V) if mass-true, else k0 exp V.
    """

    law: NamedTuple
    stack: Stack
    profile: Profile
    measure: int

    @cached_property
    def height(self):
        return float(self.stack.height.sum())

    @cached_property
    def solid(self):
        """Height [m] that grains and water fill."""
        return float(self.stack.density_ratio @ self.stack.height)

    @property
    def deepest(self):
        """Indentation [m] short of which all pores are shut, or the circle is buried to its axis."""
        return DEEPEST * (self.profile.radius if self.buried else self.height - self.solid)

    @property
    def buried(self):
        """Whether the circle is buried to its axis before all pores are shut."""
        return bool(self.profile.curl) and self.profile.radius < self.height - self.solid

    @property
    def rest(self):
        """y of `confined.travel` before the pass."""
        y = np.zeros(OWN + 2 * len(self.stack.height))
        y[OWN::2] = self.stack.pressure
        return y

    @property
    def settling(self):
        """Powers of e by which the shares of the stress settle until all pores are shut, or some more."""
        return max(settling(self.law, k) for k in self.stack.density_ratio.tolist())

    def edge(self, depth):
        """x [m] at which the roller is `depth` above its lowest point."""
        R, c = self.profile
        return math.sqrt(depth * (2 * R - c * depth)) if R else depth

    def front(self, depth):
        """u of `confined.travel` there [m]."""
        R, c = self.profile
        return 2 * R * math.sqrt(depth / (2 * R - c * depth)) if R else depth

    def places(self, u):
        """x [m] of some u of `confined.travel`."""
        R, c = self.profile
        return u / (1 + c * (u / (2 * R)) ** 2) if R else u

    @property
    def elastic(self):
        """Oedometric modulus [Pa] inside the yield limit."""
        return self.law.K + 4 * self.law.G / 3

    @property
    def slack(self):
        """Elastic strain of volume that a release may take back beyond rest, at most: mix in tension sideways."""
        return (self.law.pt + max(0.0, float(self.stack.pressure.max()))) / self.law.K

    def stress(self, depth):
        """Vertical stress [Pa] that is about that under the lowest generatrix."""
        law, densest = self.law, max(max(self.stack.density_ratio.tolist()), self.solid / (self.height - depth))
        return min(self.elastic * -math.log1p(-depth / self.height), hardening(law, densest)[0] + law.pt)

    def scale(self, depth, rtol):
        """Errors of y that a step may make in a pass at an indentation."""
        stress = self.stress(depth)
        own = [stress, -math.log1p(-depth / self.height)] * len(self.stack.height)
        return rtol * np.array([stress, stress * self.edge(depth), *[stress * depth] * 3, *own])

    def density_ratios(self, y):
        V, k0 = y[OWN + 1 :: 2], self.stack.density_ratio
        return k0 / (1 - V) if self.measure == MASS_TRUE else k0 * np.exp(V)

    def elastic_strains(self, y):
        """Of volume, since the columns were at rest."""
        return (y[OWN::2] - self.stack.pressure) / self.law.K

    def heights(self, y):
        strain = y[OWN + 1 :: 2] + self.elastic_strains(y)
        return self.stack.height * (np.exp(-strain) if self.measure == LOGARITHMIC else 1 - strain)

    def travelled(self, u, u_to, y, stress_to, scale, longest=np.inf):
        """Path of `confined.travel`, this bed with what pc remembers then, and the number of evaluations."""
        path, journey, ended = np.empty((ROWS, len(y) + 1)), begun(self.stack), PAUSED
        path[0, 0], path[0, 1:] = u, y
        given = self.law, self.stack, self.profile, self.measure, u_to, stress_to, scale, longest, journey
        most = max(SLICE // len(self.stack.height), 1)
        while ended == PAUSED:  # an interrupt gets in between two calls
            ended = travel(*given, path, most)
            if ended == PAUSED and journey.counts[ROW] + 1 == len(path):
                path = np.concatenate([path, np.empty_like(path)])
        path = path[: journey.counts[ROW] + 1]
        if ended != REACHED:
            x, x_to, x_from = (float(self.places(place)) for place in (path[-1, 0], u_to, u))
            raise RuntimeError(
                f"the integration stopped after {journey.counts[TRIED]} steps at x {x:.6g} m on the way from "
                f"{x_from:.6g} to {x_to:.6g} m, vertical stress {path[-1, 1]:.6g} Pa: {FAILURES[ended]}"
            )
        left = replace(self, stack=self.stack._replace(hardened=journey.hardened))
        return path, left, int(journey.counts[EVALUATIONS])

    def passed(self, indentation, rtol, longest=np.inf):
        """The `PassResult` of the roller at an indentation [m]; `longest` share of the front that a step may take."""
        scale, front = self.scale(indentation, rtol), self.front(indentation)
        down, pressed, evaluations = self.travelled(front, 0.0, self.rest, np.inf, scale, front * longest)
        return pressed.released(down, indentation, scale, evaluations, front * longest)

    def released(self, down, indentation, scale, evaluations, longest=np.inf):
        """The `PassResult` from the lowest point on, after `down` and its evaluations; `longest` step over u [m]."""
        rise = FAR * indentation
        far = self.front(min(rise, self.profile.radius) if self.profile.curl else rise)
        up, left, more = self.travelled(0.0, far, down[-1, 1:], 0.0, scale, longest)
        if up[-1, 1 + STRESS] > 0:
            raise RuntimeError(
                f"the rebound does not end: {up[-1, 1]:.6g} Pa are left {self.places(far):.6g} m behind the lowest "
                f"point at an indentation of {indentation:.6g} m"
            )
        return PassResult(left, indentation, down, up, evaluations + more)


@dataclass(frozen=True)
class PassResult:
    """A pass computed: the `bed` after it; paths of `confined.travel` `down` to the lowest point and `up` from it."""

    bed: Bed
    indentation: float
    down: np.ndarray
    up: np.ndarray
    evaluations: int

    @property
    def load(self):
        """P [N/m]; u shrinks on the way down."""
        return float(self.up[-1, 1 + PUSH] - 2 * self.down[-1, 1 + PUSH])

    @property
    def resistance(self):
        """F [N/m]"""
        return -float(self.up[-1, 1 + DRAG])

    @property
    def peak_pressure(self):
        return float(self.down[-1, 1 + STRESS])

    @property
    def work(self):
        """Plastic and elastic work that the columns keep [N/m]."""
        return float(self.up[-1, 1 + PLASTIC]), float(self.up[-1, 1 + ELASTIC])

    @property
    def density_ratio(self):
        """k after the rebound, mean over the height."""
        y = self.up[-1, 1:]
        heights = self.bed.heights(y)
        return float(self.bed.density_ratios(y) @ heights / heights.sum())

    @property
    def columns(self):
        y = self.up[-1, 1:]
        rows = (self.bed.heights(y), self.bed.density_ratios(y), 1.5 * y[OWN::2], self.bed.stack.hardened)
        return tuple(Column(*numbers) for numbers in np.array(rows).T.tolist())

    @property
    def mass_residual(self):
        """See `ColumnContactResult`."""
        y, stack = self.down[-1, 1:], self.bed.stack
        solid = stack.density_ratio * stack.height
        needed = solid / self.bed.density_ratios(y) * np.exp(-self.bed.elastic_strains(y))
        return float(needed.sum() / (self.bed.height - self.indentation) - 1)


def bed_of(columns, material, rate_factor, profile, measure):
    """The `Bed` of some `Column`s; pc is larger than at the reference speed by `rate_factor`."""
    rows = [(column.height, column.density_ratio, column.lateral_stress, column.hardened) for column in columns]
    height, density_ratio, lateral_stress, hardened = np.array(rows, dtype=float).T.copy()
    stack = Stack(height, density_ratio, lateral_stress / 1.5, hardened)
    return Bed(cap_constants(material, rate_factor), stack, profile, measure)
