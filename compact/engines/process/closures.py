"""Amount of the feed of a forming process from its closure: gap, density of the product, or pressure of extrusion.

    gap                    make-up t = max(0, h0 + gap - surface) at every fed stroke
    product_density_ratio  gap of the law "room", or thickness of the other laws, by a bracketed root
    extrusion_pressure     make-up that brings the stress to the pressure, at most what the sleeves offer

The gap is ill-conditioned: elastic recovery lifts the surface by most of it, so that a tenth of a millimetre decides
between loose mix and closed pores. The root is sought over -ln(1 - k), which is nearly linear in the amount.

The yield pressure depends on the rate of compaction. All strokes of a process have one rate, that of a layer which the
roller presses by the mean bite to the height h0; the mean is weighted by the make-up of the strokes. With one stroke
the rate is that of a single pass.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.optimize import brentq

from compact.engines.process.forming import Closure, Feed, Fill, FormingMachine
from compact.engines.process.section import (
    DEFAULT_LAYERS,
    BiteError,
    MakeUp,
    OverfilledError,
    SectionHistory,
    SectionOptions,
    SectionState,
    simulate_section,
    thickness_at_pressure,
)
from compact.material.laws import Compaction
from compact.numerics import Array
from compact.rolling_contact import compaction_rate

RATE_TOLERANCE = 1e-9  # [-], relative change of the rate factor in the last iteration
RATE_ITERATIONS_MAX = 30  # [-]; 4 to 6 are usual, each reduces the change a hundredfold
AMOUNT_RTOL = 1e-10  # [-], of the amount; the load changes by some 20 times as much
SEARCH_LAYERS = 1  # [-], merged layers during the search for an amount
DENSITY_TOLERANCE = 1e-9  # [-], of the density ratio of the product
OVERFILLED_DENSITY_RATIO = 1 - 1e-6  # [-], stands for a section whose pores are closed, so that the search is bounded
BITE_ROUNDING = 1e-9  # [-], relative, of the bite at the nip angle


@dataclass(frozen=True, eq=False)
class ClosedProcess:
    """Strokes on a section whose feed satisfies the closure.

    Parameters
    ----------
    history : SectionHistory
        Strokes.
    amount : float
        Gap of the law "room", or largest make-up of the other laws [m]; nan with a pressure of extrusion.
    offered : ndarray
        Thickness that the sleeves offer before each stroke [m]; the make-up itself but for a pressure of extrusion.
    """

    history: SectionHistory
    amount: float
    offered: Array


@dataclass(frozen=True)
class FormingProblem:
    """Machine, mix and feed of a process.

    Parameters
    ----------
    machine : FormingMachine
        Geometry and motion of roller and mould.
    material : Compaction
        Constitutive law of the mix.
    fill, feed : Fill, Feed
        Mix in the mould before the first stroke, and mix fed before the strokes.
    layers : int
        Merged layers of a section.
    """

    machine: FormingMachine
    material: Compaction
    fill: Fill
    feed: Feed
    layers: int = DEFAULT_LAYERS

    def with_amount(self, amount: float, options: SectionOptions) -> SectionHistory:
        """Compute the strokes with a gap, or a largest make-up of the laws without a gap [m].

        Parameters
        ----------
        amount : float
            Gap of the law "room", or largest make-up of the other laws [m].
        options : SectionOptions
            Rate of compaction, layers and accuracy.

        Returns
        -------
        SectionHistory
        """
        shares = self.feed.shares(self.machine)
        if self.feed.law == "room":
            return self._simulate(partial(_room, self.machine.height + amount, shares), options)
        thickness = amount * shares
        return self._simulate(lambda index, _: float(thickness[index]), options)

    def at_pressure(self, pressure: float, offered: Array, rate_factor: float) -> SectionHistory:
        """Compute the strokes with a make-up that brings the stress to a pressure [Pa], at most that offered [m].

        Parameters
        ----------
        pressure : float
            Largest vertical stress under the roller [Pa].
        offered : ndarray, shape (strokes,)
            Thickness that the sleeves offer before each stroke [m].
        rate_factor : float
            Factor of the yield pressure [-].

        Returns
        -------
        SectionHistory
        """

        def make_up(index: int, state: SectionState) -> float:
            room = self.machine.height + self.machine.max_bite - state.height
            most = min(float(offered[index]), max(room, 0.0))
            if most <= 0:
                return 0.0
            density_ratio = self.feed.density_ratio
            needed = thickness_at_pressure(state, self.machine, self.material, density_ratio, pressure, rate_factor)
            return min(most, needed)

        return self._simulate(make_up, SectionOptions(rate_factor, self.layers))

    def rate_factor(self, bite: float) -> float:
        """Return the factor of the yield pressure [-] for a mean bite [m]."""
        if not (self.material.rate_sensitivity and bite > 0):
            return 1.0
        machine = self.machine
        rate = compaction_rate(machine.cart_speed, machine.roller_radius, machine.height + bite, bite)
        return self.material.rate_factor(rate)

    def rate_factor_at(self, amount: float, rate_factor: float) -> float:
        """Return the factor of the yield pressure for an amount [m]: the bite of the law "room" is the gap itself."""
        return self.rate_factor(amount) if self.feed.law == "room" else rate_factor

    def product_density_ratio(self, history: SectionHistory) -> float:
        """Return the mean density ratio of the product [-], whose sections have had N strokes rounded up or down."""
        return mean_of_product(self.machine, np.array([state.density_ratio for state in history.states[-2:]]))

    def _simulate(self, make_up: MakeUp, options: SectionOptions) -> SectionHistory:
        return simulate_section(self.machine, self.material, self.fill, self.feed, make_up, options)


def solve_closure(problem: FormingProblem, closure: Closure) -> ClosedProcess:
    """Compute the strokes of a process.

    Parameters
    ----------
    problem : FormingProblem
        Machine, mix and feed.
    closure : Closure
        Condition on the feed.

    Returns
    -------
    ClosedProcess

    Raises
    ------
    OverfilledError
        If the gap closes all pores.
    BiteError
        If a bite exceeds that at the nip angle.
    ValueError
        If the density of the product cannot be reached, or the pressure closes all pores.
    """
    if closure.kind == "gap" and problem.feed.law != "room":
        raise ValueError(f"a `gap` is a closure of the feed law 'room', got {problem.feed.law!r}; give the density")
    solve = SOLVERS[closure.kind]
    factor = problem.rate_factor(closure.value if closure.kind == "gap" else problem.machine.max_bite)
    for _ in range(RATE_ITERATIONS_MAX):
        closed = solve(problem, closure, factor)
        before, factor = closed.history.rate_factor, problem.rate_factor(mean_bite(closed.history))
        if abs(factor / before - 1) <= RATE_TOLERANCE:
            break
    else:
        raise RuntimeError(f"the rate factor still changes by {abs(factor / before - 1):.1e} between two iterations")
    require_bite(problem.machine, closed.history)
    return closed


def require_bite(machine: FormingMachine, history: SectionHistory) -> None:
    """Raise BiteError unless the roller draws in the mix of every stroke.

    Parameters
    ----------
    machine : FormingMachine
        Machine, whose nip angle limits the bite.
    history : SectionHistory
        Strokes.
    """
    stroke = int(history.bite.argmax())
    bite, limit = float(history.bite[stroke]), machine.max_bite
    if bite > limit * (1 + BITE_ROUNDING):
        raise BiteError(
            f"stroke {stroke + 1} would have to draw in mix {bite * 1e3:.3g} mm above the lowest generatrix, and the "
            f"nip angle of {machine.nip_angle:g} degrees admits {limit * 1e3:.3g} mm, R (1 - cos nip); more strokes on "
            "a section, that is a slower mould, a faster cart or a longer roller, or less mix at a time are needed"
        )


def mean_of_product(machine: FormingMachine, values: Array) -> float:
    """Return the mean of a quantity over the product from its values one stroke before the last and at the last.

    Parameters
    ----------
    machine : FormingMachine
        Machine.
    values : ndarray
        Values one stroke before the last, and at the last.

    Returns
    -------
    float
        Mean in the unit of the values.
    """
    share = float(machine.stroke_shares[-1])
    return float((1 - share) * values[0] + share * values[-1])


def _room(surface: float, shares: Array, index: int, state: SectionState) -> float:
    """Return the room up to a surface [m]; 0 before a stroke without feed."""
    return max(surface - state.height, 0.0) if shares[index] > 0 else 0.0


def mean_bite(history: SectionHistory) -> float:
    """Return the mean bite [m], weighted by the make-up of the strokes; of equal weights without any.

    Parameters
    ----------
    history : SectionHistory
        Strokes.
    """
    weights = history.make_up if history.make_up.any() else np.ones(history.count)
    return float(np.average(np.maximum(history.bite, 0.0), weights=weights))


def _solve_gap(problem: FormingProblem, closure: Closure, rate_factor: float) -> ClosedProcess:
    history = problem.with_amount(closure.value, SectionOptions(rate_factor, problem.layers))
    return ClosedProcess(history, closure.value, history.make_up)


def _solve_pressure(problem: FormingProblem, closure: Closure, rate_factor: float) -> ClosedProcess:
    offer = problem.machine.max_bite if closure.offered is None else closure.offered
    offered = offer * problem.feed.shares(problem.machine)
    return ClosedProcess(problem.at_pressure(closure.value, offered, rate_factor), float("nan"), offered)


def _solve_density(problem: FormingProblem, closure: Closure, rate_factor: float) -> ClosedProcess:
    """Find the amount by Brent's method with few layers, and compute its strokes with all layers."""
    target, machine = closure.value, problem.machine
    residual = _density_residual(problem, target, rate_factor)
    low, high = 0.0, machine.max_bite if problem.feed.law == "room" else _full_amount(problem)
    if residual(low) > 0:
        raise ValueError(
            f"`product_density_ratio` must exceed the density ratio without any feed, got {target!r}; the fill is "
            "dense or high enough already"
        )
    if residual(high) < 0:
        factor = problem.rate_factor_at(high, rate_factor)
        densest = problem.product_density_ratio(problem.with_amount(high, SectionOptions(factor, SEARCH_LAYERS)))
        raise BiteError(
            f"`product_density_ratio` must be at most {densest:.6g} in {machine.strokes_on_section:.4g} strokes whose "
            f"bite is that at the nip angle, {machine.max_bite * 1e3:.3g} mm, got {target!r}; more strokes on a "
            "section are needed: a slower mould, a faster cart or a longer roller"
        )
    amount = brentq(residual, low, high, xtol=DENSITY_TOLERANCE * machine.height / 100, rtol=AMOUNT_RTOL)
    options = SectionOptions(problem.rate_factor_at(amount, rate_factor), problem.layers)
    history = problem.with_amount(amount, options)
    return ClosedProcess(history, amount, history.make_up)


def _full_amount(problem: FormingProblem) -> float:
    """Return the largest make-up at which fill and feed without pores would fill the height h0 [m]."""
    room = problem.machine.height - problem.fill.density_ratio * problem.fill.height
    return max(room, 0.0) / problem.feed.density_ratio / float(problem.feed.shares(problem.machine).sum())


def _density_residual(problem: FormingProblem, target: float, rate_factor: float) -> Callable[[float], float]:
    """Return the function of the amount [m] that is 0 where the product has a density ratio."""

    def residual(amount: float) -> float:
        options = SectionOptions(problem.rate_factor_at(amount, rate_factor), SEARCH_LAYERS)
        try:
            history = problem.with_amount(amount, options)
            reached = min(problem.product_density_ratio(history), OVERFILLED_DENSITY_RATIO)
        except (OverfilledError, BiteError):
            reached = OVERFILLED_DENSITY_RATIO
        return float(np.log((1 - target) / (1 - reached)))

    return residual


SOLVERS: dict[str, Callable[[FormingProblem, Closure, float], ClosedProcess]] = {
    "gap": _solve_gap,
    "product_density_ratio": _solve_density,
    "extrusion_pressure": _solve_pressure,
}
