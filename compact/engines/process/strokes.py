"""Strokes of one roller on a section of the product, as stacked columns of the engine "column", and their closure.

Mix is added on the section before a stroke, and the roller presses the stack down to the lowest generatrix h0. Behind
the roller the stack recovers elastically; density and locked-in stress of every layer are the initial state of the next
stroke. All layers share the vertical stress. Layers that have yielded under the same stress are nearly in the same
state and are merged, two neighbours into one of the same height and mass of grains.

The mass of grains, over the area of a section and the density of mix without air, is a height,

    m = k h exp(p/K),

with the plastic density ratio k, the height h and the mean stress p of a layer at rest: k h alone misses the elastic
strain, 1e-3 of it. Strokes conserve m, and so does merging.

Columns neither shear nor flow sideways. Their load is a lower estimate: in two dimensions the top of the section is
pressed first, and the same mean density requires a load several times as large.

A closure determines the amount of the feed:

    gap                    make-up t = max(0, h0 + gap - surface) at every fed stroke
    product_density_ratio  gap of the law "room", or thickness of the other laws, by a bracketed root
    extrusion_pressure     make-up that brings the stress to the pressure, at most what the sleeves offer

The gap is ill-conditioned: elastic recovery lifts the surface by most of it, so that a tenth of a millimetre decides
between loose mix and closed pores. The root is sought over -ln(1 - k), which is nearly linear in the amount.

The yield pressure depends on the rate of compaction. All strokes of a process have one rate, that of a layer which the
roller presses by the mean bite to the height h0; the mean is weighted by the make-up of the strokes. With one stroke
the rate is that of a single pass.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import brentq

from compact.engines.column.column_ode import GapShape
from compact.engines.column.column_pass import PLATE, Column, column_layer, grain_height, plate_indentation
from compact.engines.column.engine import INTEGRATION_RTOL
from compact.engines.process.forming import Closure, Feed, FormingMachine
from compact.engines.process.kneading import Kneading
from compact.material.laws import Compaction
from compact.numerics import Array
from compact.numerics.validation import require_positive
from compact.rolling_contact import compaction_rate

MakeUp = Callable[[int, "SectionState"], float]  # thickness [m] before a stroke, from its index and the section

DEFAULT_LAYERS = 20  # [-], merged layers of a section; 3 and 80 give the same load to 1e-8
QUARTER = 0.25  # [-], share of the height over which the density of bottom and top is averaged
CONTACT_SHARE = 1e-12  # [-], of the height; a smaller bite is no contact
RATE_TOLERANCE = 1e-9  # [-], relative change of the rate factor in the last iteration
RATE_ITERATIONS_MAX = 30  # [-]; 4 to 6 are usual, each reduces the change a hundredfold
AMOUNT_RTOL = 1e-10  # [-], of the amount; the load changes by some 20 times as much
SEARCH_LAYERS = 1  # [-], merged layers during the search for an amount
DENSITY_TOLERANCE = 1e-9  # [-], of the density ratio of the product
OVERFILLED_DENSITY_RATIO = 1 - 1e-6  # [-], stands for a section whose pores are closed, so that the search is bounded
QUADRATURE_POINTS = 64  # [-], of Gauss and Legendre over ln(1 - k); the error is below 1e-12 up to k = 0.99
BITE_ROUNDING = 1e-9  # [-], relative, of the bite at the nip angle


class FeedError(ValueError):
    """Error for more mix than the roller draws in, or than grains and water leave room for below it."""


@dataclass(frozen=True)
class SectionState:
    """Section at rest.

    Parameters
    ----------
    columns : tuple of Column
        Layers from the base upwards.
    bulk_modulus : float
        Bulk modulus K of the mix [Pa].
    """

    columns: tuple[Column, ...]
    bulk_modulus: float

    @property
    def height(self) -> float:
        """Height of the surface [m]."""
        return sum(column.height for column in self.columns)

    @property
    def grain_height(self) -> float:
        """Mass of grains as a height [m], elastic strain included."""
        return sum(grain_height(column, self.bulk_modulus) for column in self.columns)

    @property
    def density_ratio(self) -> float:
        """Mean density ratio over the height [-]."""
        heights, ratios, *_ = np.array(self.columns).T
        return mean_over_height(heights, ratios, 0.0, 1.0)

    def merged(self, count: int) -> "SectionState":
        """Merge neighbours until `count` layers remain, those with the least difference of density over height first.

        Layers that have yielded under the same stress have the same density; fill that is denser than the feed stays
        apart until it yields. A merged layer has the height and the grains of its parts.
        """
        kept, K = list(self.columns), self.bulk_modulus
        while len(kept) > count:
            heights, ratios, *_ = np.array(kept).T
            place = int(np.argmin(np.abs(np.diff(ratios)) * np.minimum(heights[1:], heights[:-1])))
            below, above = kept[place : place + 2]
            masses = np.array([grain_height(below, K), grain_height(above, K)])
            total, height = float(masses.sum()), below.height + above.height
            stress = float(masses / total @ [below.lateral_stress, above.lateral_stress])
            densest = float(masses / total @ [below.max_density_ratio, above.max_density_ratio])
            ratio = total / height * float(np.exp(-stress / 1.5 / K))
            kept[place : place + 2] = [Column(height, ratio, stress, densest)]
        return replace(self, columns=tuple(kept))


@dataclass(frozen=True, eq=False)
class SectionHistory:
    """Strokes on one section, arrays of shape (strokes,); forces per unit roller length.

    Parameters
    ----------
    make_up, bite : ndarray
        Thickness of mix added before the stroke, and height of the surface above the lowest generatrix [m].
    load, resistance : ndarray
        P and F [N/m].
    peak_pressure : ndarray
        Vertical stress under the lowest generatrix [Pa].
    leading, trailing : ndarray
        Distance of the contact's edges from the lowest generatrix, ahead and behind [m].
    work : ndarray
        Plastic work and increase of the locked-in elastic energy per unit length of travel [N/m].
    states : tuple of SectionState
        Section before the first stroke and after each, length strokes + 1.
    problem : FormingProblem
        Machine, mix and feed.
    rate_factor : float
        Factor of the yield pressure by the rate of compaction [-].
    amount : float
        Gap of the law "room", or largest make-up of the other laws [m]; nan with a pressure of extrusion.
    offered : ndarray
        Thickness that the sleeves offer before each stroke [m]; the make-up itself but for a pressure of extrusion.
    """

    make_up: Array
    bite: Array
    load: Array
    resistance: Array
    peak_pressure: Array
    leading: Array
    trailing: Array
    work: Array
    states: tuple[SectionState, ...]
    problem: "FormingProblem"
    rate_factor: float
    amount: float
    offered: Array

    @property
    def count(self) -> int:
        """Number of strokes."""
        return len(self.load)

    @property
    def surface(self) -> Array:
        """Height of the surface after each stroke [m]."""
        return np.array([state.height for state in self.states[1:]])

    @property
    def density_ratio(self) -> Array:
        """Mean density ratio after each stroke [-]."""
        return np.array([state.density_ratio for state in self.states[1:]])

    @property
    def mean_bite(self) -> float:
        """Mean bite [m], weighted by the make-up of the strokes; of equal weights without any."""
        weights = self.make_up if self.make_up.any() else np.ones(self.count)
        return float(np.average(np.maximum(self.bite, 0.0), weights=weights))

    @property
    def mass_residual(self) -> float:
        """Grains in the section after the last stroke over those of fill and feed, less 1 [-]."""
        fed = self.states[0].grain_height + self.problem.feed.density_ratio * float(self.make_up.sum())
        return self.states[-1].grain_height / fed - 1

    @property
    def work_residual(self) -> float:
        """Resistance of all strokes over the work left in the mix, less 1 [-]; 0 without resistance."""
        total = float(self.resistance.sum())
        return abs(total - float(self.work.sum())) / total if total else 0.0

    def of_product(self, name: str) -> float:
        """Return the mean over the product of a quantity of `SectionState`."""
        return self.problem.machine.mean_of_product(*(getattr(state, name) for state in self.states[-2:]))

    def within_nip(self) -> "SectionHistory":
        """Return the strokes; raise FeedError unless the roller draws in the mix of each of them."""
        stroke, machine = int(self.bite.argmax()), self.problem.machine
        bite, limit = float(self.bite[stroke]), machine.max_bite
        if bite > limit * (1 + BITE_ROUNDING):
            raise FeedError(
                f"stroke {stroke + 1} would have to draw in mix {bite * 1e3:.3g} mm above the lowest generatrix, and "
                f"the nip angle of {machine.nip_angle:g} degrees admits {limit * 1e3:.3g} mm, R (1 - cos nip); more "
                "strokes on a section, that is a slower mould, a faster cart or a longer roller, or less mix at a time "
                "are needed"
            )
        return self


@dataclass(frozen=True)
class FormingProblem:
    """Machine, mix and feed of a process.

    Parameters
    ----------
    machine : FormingMachine
        Geometry and motion of roller and mould.
    material : Compaction
        Constitutive law of the mix.
    fill : Column
        Loose mix in the mould before the first stroke, with its height and density ratio.
    feed : Feed
        Mix fed before the strokes.
    layers : int
        Merged layers of a section.
    kneading : Kneading, optional
        Gain of density by shear work, of lifts in two dimensions; None of mix whose Heckel slope is a kneaded one.
    """

    machine: FormingMachine
    material: Compaction
    fill: Column
    feed: Feed
    layers: int = DEFAULT_LAYERS
    kneading: Kneading | None = None

    def at_speed(self, speed: float) -> "FormingProblem":
        """Return the process at another speed of the cart [m/s]."""
        return replace(self, machine=replace(self.machine, cart_speed=speed))

    def rate_factor(self, bite: float) -> float:
        """Return the factor of the yield pressure [-] for a mean bite [m]."""
        if not (self.material.rate_sensitivity and bite > 0):
            return 1.0
        machine = self.machine
        rate = compaction_rate(machine.cart_speed, machine.roller_radius, machine.height + bite, bite)
        return self.material.rate_factor(rate)

    def with_amount(self, amount: float, rate_factor: float = 1.0) -> SectionHistory:
        """Compute the strokes with a gap, or a largest make-up of the laws without a gap [m].

        Parameters
        ----------
        amount : float
            Gap of the law "room", or largest make-up of the other laws [m].
        rate_factor : float
            Factor of the yield pressure [-].

        Returns
        -------
        SectionHistory

        Raises
        ------
        FeedError
            If grains and water fill the room below the lowest generatrix, or a bite would bury the roller to its axis.
        """
        shares, surface = self.feed.shares(self.machine), self.machine.height + amount

        def make_up(index: int, state: SectionState) -> float:
            if self.feed.law == "room":
                return max(surface - state.height, 0.0) if shares[index] > 0 else 0.0
            return float(amount * shares[index])

        return self._simulate(make_up, rate_factor, amount)

    def at_pressure(self, pressure: float, offered: Array, rate_factor: float) -> SectionHistory:
        """Compute the strokes with a make-up that brings the stress to a pressure [Pa], at most that offered [m].

            t = [h0 - h(s_v)]/[h_fresh(s_v)/h_fresh],    0 if the section alone exceeds the pressure

        Parameters
        ----------
        pressure : float
            Largest vertical stress s_v under the roller [Pa].
        offered : ndarray, shape (strokes,)
            Thickness that the sleeves offer before each stroke [m].
        rate_factor : float
            Factor of the yield pressure [-].

        Returns
        -------
        SectionHistory
        """

        def pressed_height(columns: tuple[Column, ...]) -> float:
            layer = column_layer(columns, self.material, rate_factor, PLATE)
            return layer.height - plate_indentation(layer, pressure, INTEGRATION_RTOL)

        def make_up(index: int, state: SectionState) -> float:
            room = self.machine.height + self.machine.max_bite - state.height
            most = min(float(offered[index]), max(room, 0.0))
            if most <= 0:
                return 0.0
            left = max(self.machine.height - pressed_height(state.columns), 0.0)
            return min(most, left / pressed_height((Column(1.0, self.feed.density_ratio),)))

        return replace(self._simulate(make_up, rate_factor, float("nan")), offered=offered)

    def _simulate(self, make_up: MakeUp, rate_factor: float, amount: float) -> SectionHistory:
        """Compute the strokes on a section."""
        fill, fed, height = self.fill, self.feed.density_ratio, self.machine.height
        if not fill.density_ratio > self.material.loose_density_ratio:
            raise ValueError(
                f"`density_ratio` of the fill must exceed that of Heckel's curve at its start, "
                f"{self.material.loose_density_ratio!r}, got {fill.density_ratio!r}"
            )
        gap = GapShape(float(self.machine.roller_radius), 1.0)
        columns = (Column(fill.height / self.layers, fill.density_ratio),) * self.layers
        bulk_modulus = self.material.unloading_modulus / (3 - 6 * self.material.poisson)
        states, rows = [SectionState(columns, bulk_modulus)], []
        for index in range(self.machine.stroke_count):
            state = states[-1]
            added = make_up(index, state)
            raised = (*state.columns, Column(added, fed)) if added > 0 else state.columns
            bite, forces = state.height + added - height, (0.0,) * 6
            if bite > CONTACT_SHARE * height:
                layer = column_layer(raised, self.material, rate_factor, gap)
                if not bite < self.machine.roller_radius:
                    raise FeedError(
                        f"stroke {index + 1} would bury the roller to its axis, bite {bite:.3g} m; feed less"
                    )
                if not bite < layer.max_indentation:
                    raise FeedError(f"stroke {index + 1} closes all pores: {layer.limit}; feed less mix")
                passed = layer.compute_pass(bite, INTEGRATION_RTOL)
                raised, work = passed.exit.layer, passed.own["plastic_work"] + passed.own["elastic_work"]
                edges = passed.leading, -passed.trailing
                forces = passed.load, passed.resistance, passed.peak_pressure, *edges, work
            rows.append((added, bite, *forces))
            states.append(replace(state, columns=raised).merged(self.layers))
        arrays = list(np.array(rows).T)
        fields: list[Any] = [*arrays, tuple(states), self, rate_factor, amount, arrays[0]]
        return SectionHistory(*fields)


def solve_closure(problem: FormingProblem, closure: Closure) -> SectionHistory:
    """Compute the strokes of a process.

    Parameters
    ----------
    problem : FormingProblem
        Machine, mix and feed.
    closure : Closure
        Condition on the feed.

    Returns
    -------
    SectionHistory

    Raises
    ------
    FeedError
        If the gap closes all pores, or a bite exceeds that at the nip angle.
    ValueError
        If the density of the product cannot be reached, or the pressure closes all pores.
    """
    machine, amount = problem.machine, closure.value
    offered = (machine.max_bite if closure.offered is None else closure.offered) * problem.feed.shares(machine)
    factor = problem.rate_factor(closure.value if closure.kind == "gap" else machine.max_bite)
    for _ in range(RATE_ITERATIONS_MAX):
        if closure.kind == "extrusion_pressure":
            history = problem.at_pressure(closure.value, offered, factor)
        else:
            if closure.kind == "product_density_ratio":
                amount = _amount_for_density(problem, closure.value, factor)
                if problem.feed.law == "room":  # the bite is the gap itself
                    factor = problem.rate_factor(amount)
            history = problem.with_amount(amount, factor)
        factor = problem.rate_factor(history.mean_bite)
        change = abs(factor / history.rate_factor - 1)
        if change <= RATE_TOLERANCE:
            return history.within_nip()
    raise RuntimeError(f"the rate factor still changes by {change:.1e} between two iterations")


def _amount_for_density(problem: FormingProblem, target: float, rate_factor: float) -> float:
    """Return the amount [m] at which the product has a density ratio, by Brent's method with few layers."""
    machine, feed, fill = problem.machine, problem.feed, problem.fill
    few_layers = replace(problem, layers=SEARCH_LAYERS)

    def reached(amount: float) -> float:
        factor = problem.rate_factor(amount) if feed.law == "room" else rate_factor
        return few_layers.with_amount(amount, factor).of_product("density_ratio")

    def residual(amount: float) -> float:
        try:
            ratio = min(reached(amount), OVERFILLED_DENSITY_RATIO)
        except FeedError:
            ratio = OVERFILLED_DENSITY_RATIO
        return float(np.log((1 - target) / (1 - ratio)))

    most = machine.max_bite
    if feed.law != "room":  # fill and feed without pores fill the height h0
        room = max(machine.height - fill.density_ratio * fill.height, 0.0)
        most = room / feed.density_ratio / float(feed.shares(machine).sum())
    if residual(0.0) > 0:
        raise ValueError(
            f"`product_density_ratio` must exceed the density ratio without any feed, got {target!r}; the fill is "
            "dense or high enough already"
        )
    if residual(most) < 0:
        raise FeedError(
            f"`product_density_ratio` must be at most {reached(most):.6g} in {machine.strokes_on_section:.4g} strokes "
            f"whose bite is that at the nip angle, {machine.max_bite * 1e3:.3g} mm, got {target!r}; more strokes on a "
            "section are needed: a slower mould, a faster cart or a longer roller"
        )
    return float(brentq(residual, 0.0, most, xtol=DENSITY_TOLERANCE * machine.height / 100, rtol=AMOUNT_RTOL))


def mean_over_height(heights: Array, values: Array, low: float, high: float) -> float:
    """Return the mean of values of layers between two shares of the height.

    Parameters
    ----------
    heights, values : ndarray, shape (layers,)
        Heights [m] and values of the layers from the base upwards.
    low, high : float
        Shares of the height [-], low < high; 0 at the base and 1 at the surface.

    Returns
    -------
    float
        Mean in the unit of the values.
    """
    tops = np.append(0.0, np.cumsum(heights))
    bounds = np.clip(tops, low * tops[-1], high * tops[-1])
    return float(np.diff(bounds) @ values / (bounds[-1] - bounds[0]))


def confined_stress(material: Compaction, density_ratio: float | Array, rate_factor: float) -> Array:
    """Return the vertical stress of confined compression of rigid-plastic mix at a density ratio [Pa]."""
    strength = material.tensile_strength
    yielding = rate_factor * material.yield_pressure(density_ratio) + strength
    return np.asarray(material.confined_stress_ratio * yielding - strength)


def confined_work(
    material: Compaction, entries: Iterable[tuple[float, float]], density_ratio: float, rate_factor: float = 1.0
) -> float:
    """Compute the work of confined compression per volume of the product [J/m3].

    Parameters
    ----------
    entries : iterable of (share, density_ratio)
        Share of the grains of the product [-] and their density ratio at entry [-]; the shares add up to 1.
    density_ratio : float
        Density ratio of the product [-], below 1.
    rate_factor : float
        Factor of the yield pressure [-].

    Returns
    -------
    float
        Work w per volume of the product [J/m3].

    Examples
    --------
    >>> mix = Compaction(unloading_modulus=60e6, poisson=0.3, heckel_slope=13e-6,
    ...                  loose_density_ratio=0.72, critical_slope=1.2, tensile_strength=14e3, fed_density_ratio=0.75)
    >>> f"{confined_work(mix, [(1.0, 0.75)], 0.98) / 1e3:.2f} kJ/m3"
    '22.21 kJ/m3'
    """
    if not 0 < density_ratio < 1:
        raise ValueError(f"`density_ratio` must lie between 0 and 1, got {density_ratio!r}")
    require_positive(rate_factor=rate_factor)
    nodes, weights = np.polynomial.legendre.leggauss(QUADRATURE_POINTS)
    work = 0.0
    for share, entry in entries:
        low, high = -np.log1p(-entry), -np.log1p(-density_ratio)
        u = (low + high) / 2 + (high - low) / 2 * nodes
        k = -np.expm1(-u)
        integrand = confined_stress(material, k, rate_factor) / k**2 * (1 - k)  # dk = (1 - k) du
        work += share * (high - low) / 2 * float(weights @ integrand)
    return density_ratio * work
