"""Results of a forming process along one roller: load, resistance, density, and the balances of grains and work.

The sections under the roller have had 1, 2, ... N strokes, so that the forces of the strokes on one section, in order,
are those along the roller at one instant:

    P = sum_n P_n dz_n,    F = sum_n F_n dz_n,    z_P = sum_n P_n z_n dz_n/P,    M = P (z_P - L/2)

with the length dz_n = v_form T on which stroke n meets its sections, of the last stroke the rest of L. M is the moment
by which the load tilts the roller in its guides.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from compact.engines.process.closures import ClosedProcess, FormingProblem, mean_of_product
from compact.engines.process.confined_floor import GrainShare, confined_floor, confined_work
from compact.engines.process.forming import Closure
from compact.engines.process.section import (
    QUARTER,
    SectionHistory,
    grain_height,
    mean_density_ratio,
    overpressed_height,
)
from compact.numerics import Array


@dataclass(frozen=True)
class MixFlow:
    """Mix that passes a section in one stroke, as heights of grains over the area that the roller sweeps [m].

    Times the advance of the mould, the length of the stroke and the density of the mix without air it is a mass.

    Parameters
    ----------
    product : float
        Grains in the product.
    fill : float
        Grains that the mould carries in.
    fed : float
        Grains that the strokes take from the sleeves.
    extruded : float
        Grains that are offered, not taken and pushed towards the empty mould, at most the fill.
    retained : float
        Grains that are offered and stay in the sleeves, since no more can be pushed out.
    missing : float
        Grains by which the product is lighter than one of the required density.
    """

    product: float
    fill: float
    fed: float
    extruded: float
    retained: float
    missing: float

    @property
    def residual(self) -> float:
        """Grains of the product over those of fill and feed, less 1 [-]."""
        return self.product / (self.fill + self.fed) - 1


@dataclass(frozen=True, eq=False)
class RollerRow:
    """Forming process of one roller.

    Parameters
    ----------
    problem : FormingProblem
        Machine, mix and feed.
    closure : Closure
        Condition on the feed.
    closed : ClosedProcess
        Strokes that satisfy it.
    required_density_ratio : float
        Density ratio that the product should have [-].
    """

    problem: FormingProblem
    closure: Closure
    closed: ClosedProcess
    required_density_ratio: float

    @property
    def history(self) -> SectionHistory:
        """Strokes on one section."""
        return self.closed.history

    @cached_property
    def lengths(self) -> Array:
        """Length of the roller on which each stroke meets its sections [m]; at rest the whole of it in the last."""
        machine = self.problem.machine
        if machine.strokes is not None:
            return np.append(np.zeros(machine.stroke_count - 1), machine.roller_length)
        return machine.advance * machine.stroke_shares

    @property
    def edges(self) -> Array:
        """Ends of these lengths along the roller [m], shape (strokes + 1,)."""
        return np.append(0.0, np.cumsum(self.lengths))

    @property
    def load(self) -> float:
        """Load of the roller [N]."""
        return float(self.history.load @ self.lengths)

    @property
    def resistance(self) -> float:
        """Resistance of the roller [N]."""
        return float(self.history.resistance @ self.lengths)

    @property
    def load_centre(self) -> float:
        """Centre of the load from the edge at the empty mould [m]; the middle of the roller without load."""
        return self.centre_of(self.history.load)

    def centre_of(self, line_load: Array) -> float:
        """Return the centre of the loads of the strokes per unit roller length [N/m], from the empty mould [m]."""
        middle = (self.edges[:-1] + self.edges[1:]) / 2
        load = line_load * self.lengths
        return float(load @ middle / load.sum()) if load.sum() else self.problem.machine.roller_length / 2

    @property
    def skew_moment(self) -> float:
        """Moment of the load about the middle of the roller [N m], + towards the finished product."""
        return self.load * (self.load_centre - self.problem.machine.roller_length / 2)

    @property
    def load_unevenness(self) -> float:
        """Largest over mean load per unit length [-]; 1 without load."""
        mean = self.load / self.problem.machine.roller_length
        return float(self.history.load[self.lengths > 0].max()) / mean if mean else 1.0

    @property
    def peak_pressure(self) -> float:
        """Largest vertical stress under the roller [Pa]."""
        return float(self.history.peak_pressure.max())

    def _of_product(self, values: tuple[float, ...]) -> float:
        return mean_of_product(self.problem.machine, np.array(values))

    @property
    def product_height(self) -> float:
        """Height of the product after its elastic recovery [m]."""
        return self._of_product(tuple(state.height for state in self.history.states[-2:]))

    @property
    def product_density_ratio(self) -> float:
        """Mean density ratio of the product [-]."""
        return self.problem.product_density_ratio(self.history)

    @property
    def bottom_density_ratio(self) -> float:
        """Mean density ratio of the bottom quarter of the product [-]."""
        return self._of_product(tuple(mean_density_ratio(s.columns, 0, QUARTER) for s in self.history.states[-2:]))

    @property
    def top_density_ratio(self) -> float:
        """Mean density ratio of the top quarter of the product [-]."""
        return self._of_product(tuple(mean_density_ratio(s.columns, 1 - QUARTER, 1) for s in self.history.states[-2:]))

    @property
    def overpressed_height(self) -> float:
        """Height of the product whose density ratio exceeds 1 [m]; columns close their pores before that."""
        return overpressed_height(self.history.states[-1].columns)

    @cached_property
    def flow(self) -> MixFlow:
        """Grains of product, fill and feed per stroke."""
        history, problem = self.history, self.problem
        bulk, k_feed = history.states[0].law.K, problem.feed.density_ratio
        fill = sum(grain_height(column, bulk) for column in history.states[0].columns)
        fed = k_feed * self._of_product((float(history.make_up[:-1].sum()), float(history.make_up.sum())))
        product = self._of_product(tuple(state.grain_height for state in history.states[-2:]))
        surplus = k_feed * self._of_product((self._surplus(slice(None, -1)), self._surplus(slice(None))))
        extruded = min(surplus, fill)
        lack = self.required_density_ratio / self.product_density_ratio - 1
        return MixFlow(product, fill, fed, extruded, surplus - extruded, max(lack, 0.0) * product)

    def _surplus(self, strokes: slice) -> float:
        return float((self.closed.offered[strokes] - self.history.make_up[strokes]).sum())

    @property
    def confined_work(self) -> float:
        """Work of confined compression in closed form per volume of the product [J/m3]; 0 without densification."""
        problem, flow = self.problem, self.flow
        entries = [
            GrainShare(flow.fill / (flow.fill + flow.fed), problem.fill.density_ratio),
            GrainShare(flow.fed / (flow.fill + flow.fed), problem.feed.density_ratio),
        ]
        return confined_work(problem.material, entries, self.product_density_ratio, self.history.rate_factor)

    @property
    def confined_floor(self) -> float:
        """Confined floor of the resistance of the roller [N]; 0 of a mould at rest."""
        return confined_floor(self.problem.machine.advance, self.product_height, self.confined_work)

    @property
    def specific_work(self) -> float:
        """Work of the roller per volume of the product [J/m3]; nan of a mould at rest, which yields none."""
        advance = self.problem.machine.advance
        return self.resistance / (advance * self.product_height) if advance else float("nan")

    @property
    def strokes_for_density(self) -> float:
        """Strokes after which a section has the required density with this feed [-]; inf if it has not."""
        ratio = np.array([state.density_ratio for state in self.history.states])
        reached = np.flatnonzero(ratio >= self.required_density_ratio)
        if not len(reached):
            return float("inf")
        n = int(reached[0])
        return float(n - 1 + (self.required_density_ratio - ratio[n - 1]) / (ratio[n] - ratio[n - 1])) if n else 0.0
