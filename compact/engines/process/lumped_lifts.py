"""Forming process in two dimensions: the feed of many strokes lumped into 10 to 20 lifts.

Every stroke starts from the whole state that the previous one has left, so that strokes cannot be computed singly and
interpolated. The feed is therefore lumped. Each lift of the thickness t, several times the make-up of a stroke, is
spread over the section and pressed down to the lowest generatrix by one pass of the engine "compaction". Density and
stress of the rows behind the pass are the initial state of the next one.

The load at a mean density hardly depends on t, and the resistance over t does; both are extrapolated to the make-up of
the strokes (`two_dimensions`). The rate of compaction is that of the strokes: the speed of each pass is chosen so that
the yield pressure has their rate factor.

Behind the roller the surface sinks below the lowest generatrix, by up to 0.5 mm in the published machine and within a
length of some contacts. It is not elastic recovery, which lifts the surface: the stress under the roller spreads into
the loose mix below, and compacts it on while the roller is already ahead.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from compact.engines.compaction.engine import roll
from compact.engines.compaction.results import CompactionContactResult
from compact.engines.compaction.roller_frame import LayerState, fresh_layer, rate_factor_at
from compact.engines.process.closures import FormingProblem
from compact.engines.process.section import QUARTER
from compact.material.laws import Compaction
from compact.numerics import Array
from compact.rolling_contact import Layer, Roller

FILL_ROWS = 40  # [-], rows of the fill, resampled to those of the mesh by the engine
STEADY_TOLERANCE = 1e-2  # [-], of load, resistance and density of a pass; small against the error of lumping
LIFTS_MAX = 40  # [-], lifts of a sequence
RATE_ROUNDING = 1e-12  # [-], rate factor less 1 below which the speed does not matter

Report = Callable[[str], None]


@dataclass(frozen=True)
class LumpedLift:
    """One lift pressed to the lowest generatrix, per unit roller length.

    Parameters
    ----------
    thickness, bite : float
        Thickness of the lift, and height of the surface above the lowest generatrix [m].
    load, resistance : float
        P and F [N/m].
    load_error, resistance_error : float
        Relative error estimates of the engine [-].
    density_before, density_ratio : float
        Mean density ratio of the section with the loose lift on it, and behind the roller [-].
    bottom_density_ratio, top_density_ratio : float
        Mean density ratio of the bottom and of the top quarter behind the roller [-].
    overpressed_height : float
        Height with a density ratio above 1, outside the law [m].
    surface : float
        Height behind the roller [m].
    peak_pressure : float
        Largest pressure [Pa].
    work_residual, mass_residual : float
        Relative residuals of the balances of the pass [-].
    row_heights, row_density_ratios : tuple of float
        Rows behind the roller from the base upwards: heights [m] and density ratios [-].
    """

    thickness: float
    bite: float
    load: float
    resistance: float
    load_error: float
    resistance_error: float
    density_before: float
    density_ratio: float
    bottom_density_ratio: float
    top_density_ratio: float
    overpressed_height: float
    surface: float
    peak_pressure: float
    work_residual: float
    mass_residual: float
    row_heights: tuple[float, ...]
    row_density_ratios: tuple[float, ...]


@dataclass(frozen=True)
class LiftSequence:
    """Lifts of one thickness until a density.

    Parameters
    ----------
    thickness : float
        Thickness t of a lift [m].
    increments : int
        Elements per contact length.
    lifts : tuple of LumpedLift
        Lifts in order.
    stopped : str
        Reason why the sequence ends before the density; empty otherwise.
    """

    thickness: float
    increments: int
    lifts: tuple[LumpedLift, ...]
    stopped: str = ""

    def values(self, name: str) -> Array:
        """Return a field of all lifts, shape (lifts,)."""
        return np.array([getattr(lift, name) for lift in self.lifts])

    @property
    def largest_work_residual(self) -> float:
        """Largest residual of the energy balance of a pass [-]."""
        return float(self.values("work_residual").max())


def simulate_lifts(
    problem: FormingProblem,
    friction: float,
    rate_factor: float,
    density_ratio: float,
    *,
    thickness: float,
    increments: int,
    report: Report = lambda _: None,
) -> LiftSequence:
    """Press lifts of one thickness until the section has a mean density ratio.

    Parameters
    ----------
    friction : float
        Friction of the mix on the free roller [-].
    rate_factor : float
        Factor of the yield pressure [-].
    density_ratio : float
        Mean density ratio after which no further lift is pressed [-].
    thickness : float
        Thickness of a lift [m].
    increments : int
        Elements per contact length.
    report : callable
        Called with a line of text after each lift.

    Returns
    -------
    LiftSequence
        Without the lifts after one that has no steady state.
    """
    lifts: list[LumpedLift] = []
    steps = _lifts(problem, friction, rate_factor, thickness, increments)
    stopped = ""
    try:
        for lift in steps:
            lifts.append(lift)
            report(f"lift {len(lifts)} of {thickness * 1e3:.3g} mm: mean density ratio {lift.density_ratio:.3f}")
            if lift.density_ratio >= density_ratio or len(lifts) == LIFTS_MAX:
                break
    except (RuntimeError, ValueError) as error:  # no steady state, or more mix than fits
        if not lifts:
            raise
        stopped = str(error).partition(";")[0]
    return LiftSequence(thickness, increments, tuple(lifts), stopped)


def _lifts(
    problem: FormingProblem, friction: float, rate_factor: float, thickness: float, increments: int
) -> Iterator[LumpedLift]:
    """Yield lifts one after the other."""
    machine = problem.machine
    material = replace(problem.material, fed_density_ratio=problem.feed.density_ratio)
    filling = replace(material, fed_density_ratio=problem.fill.density_ratio)
    state = fresh_layer(filling, np.full(FILL_ROWS, problem.fill.height / FILL_ROWS))
    while True:
        raised = state.with_lift(thickness, material)
        bite = raised.height - machine.height
        roller = Roller(machine.roller_radius, indentation=bite, friction=friction, rolling="free", profile="deformed")
        speed = _speed_of_rate(problem, material, raised, bite, rate_factor)
        passed = roll(
            Layer(raised.height), roller, material, speed,
            fed_layer=raised, increments=increments, steady_tolerance=STEADY_TOLERANCE,
        )  # fmt: skip
        yield _lift(passed, raised, thickness, bite)
        state = passed.exit


def _speed_of_rate(
    problem: FormingProblem, material: Compaction, raised: LayerState, bite: float, rate_factor: float
) -> float:
    """Return the speed [m/s] at which the yield pressure has a rate factor; that of the cart without rate effect."""
    machine, m = problem.machine, material.rate_sensitivity
    if not m or rate_factor < 1 + RATE_ROUNDING:
        return machine.cart_speed
    factor = rate_factor_at(material, machine.roller_radius, raised.height, bite, machine.cart_speed, raised)
    return machine.cart_speed * float(np.expm1((rate_factor - 1) / m) / np.expm1((factor - 1) / m))


def _lift(passed: CompactionContactResult, raised: LayerState, thickness: float, bite: float) -> LumpedLift:
    """Return the record of a pass."""
    state, error = passed.exit, passed.error
    assert error is not None  # the engine estimates its error
    tops = np.cumsum(state.heights)
    ratio = state.points.density_ratio
    return LumpedLift(
        thickness=thickness,
        bite=bite,
        load=passed.load,
        resistance=passed.resistance,
        load_error=error[0],
        resistance_error=error[1],
        density_before=raised.density_ratio,
        density_ratio=passed.exit_density_ratio,
        bottom_density_ratio=_mean(ratio, tops, 0.0, QUARTER),
        top_density_ratio=_mean(ratio, tops, 1 - QUARTER, 1.0),
        overpressed_height=float(state.heights[ratio > 1].sum()),
        surface=passed.exit_height,
        peak_pressure=float(passed.peak_pressure or 0.0),
        work_residual=passed.work_residual or 0.0,
        mass_residual=passed.mass_residual,
        row_heights=tuple(state.heights.tolist()),
        row_density_ratios=tuple(ratio.tolist()),
    )


def _mean(values: Array, tops: Array, low: float, high: float) -> float:
    """Return the mean of row values between two shares of the height."""
    bounds = np.clip(np.append(0.0, tops), low * tops[-1], high * tops[-1])
    return float(np.diff(bounds) @ values / (bounds[-1] - bounds[0]))
