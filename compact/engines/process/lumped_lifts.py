"""Forming process in two dimensions: the feed of many strokes lumped into 10 to 20 lifts.

Every stroke starts from the whole state that the previous one has left, so that strokes cannot be computed singly and
interpolated. The feed is therefore lumped. Each lift of the thickness t, several times the make-up of a stroke, is
spread over the section and pressed down to the lowest generatrix by one pass of the engine "compaction". Density and
stress of the rows behind the pass are the initial state of the next one.

The load at a mean density hardly depends on t, and the resistance over t does; both are extrapolated to the make-up of
the strokes (`two_dimensions`). The rate of compaction is that of the strokes: the speed of each pass is chosen so that
the yield pressure has their rate factor.

The stress of a contact spreads over the height of the section, which is several contact lengths. The last correction of
the bow wave may therefore still move with the mix when the engine ends, and shows as a residual of the energy. Such a
pass rolls on until its energy closes.

Pore air adds the forces of its excess pressure at the deformation of each pass ("one-way"), or the changes of load and
resistance by the coupled contact at the same height ("coupled"). Density and stress of the next pass are those without
air. Every pass starts from air at the pressure of the surroundings; the air flows at the speed of the cart.

Behind the roller the surface sinks below the lowest generatrix, by up to 0.5 mm in the published machine and within a
length of some contacts. It is not elastic recovery, which lifts the surface: the stress under the roller spreads into
the loose mix below, and compacts it on while the roller is already ahead.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from compact.engines.compaction.engine import roll
from compact.engines.compaction.incremental_rolling import DAMPING, FINAL_DAMPING_RATIO
from compact.engines.compaction.results import CompactionContactResult, build_result, field_mesh
from compact.engines.compaction.roller_frame import LayerState, fresh_layer, rate_factor_at
from compact.engines.compaction.steady_search import FINAL_TOLERANCE
from compact.engines.pore_air.coupled_rolling import roll_coupled
from compact.engines.pore_air.under_roller import RollerAir
from compact.engines.process.closures import FormingProblem
from compact.engines.process.forming import FormingMachine
from compact.engines.process.section import QUARTER
from compact.material.laws import Compaction
from compact.material.pore_air import PoreAir
from compact.numerics import Array
from compact.rolling_contact import Layer, Roller

if TYPE_CHECKING:
    import meshio

FILL_ROWS = 40  # [-], rows of the fill, resampled to those of the mesh by the engine
STEADY_TOLERANCE = 1e-2  # [-], of load, resistance and density of a pass; small against the error of lumping
LIFTS_MIN = 10  # [-], lifts of a sequence at least, so that those of a thin product are thinner
MIDDLE_SHARE = 0.75  # [-], thickness of the lifts of the middle over their largest
PROFILE_ROWS = 40  # [-], rows of equal height of a profile between two lifts
LIFTS_MAX = 40  # [-], lifts of a sequence
ENERGY_TOLERANCE = 1e-2  # [-], residual of the energy of a pass above which it rolls on
SETTLING_SHARE = 1 / 3  # [-], of the height, travel after which the energy is evaluated again
SETTLINGS_MAX = 8  # [-], of a pass; the wave relaxes over some ten contact lengths, 1.6 times the height
RATE_ROUNDING = 1e-12  # [-], rate factor less 1 below which the speed does not matter

Report = Callable[[str], None]


@dataclass(frozen=True)
class LumpedLift:
    """One lift pressed to the lowest generatrix, per unit roller length.

    Parameters
    ----------
    thickness, bite : float
        Thickness of the lift, 0 of a section pressed without one, and height of the surface above the lowest
        generatrix [m].
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
    row_heights, row_density_ratios, row_lateral_stresses : tuple of float
        Rows behind the roller from the base upwards: heights [m], density ratios [-] and lateral stress at rest [Pa].
    air_load, air_resistance : float
        Changes of load and resistance by the pore air [N/m]; 0 without air.
    air_excess_behind : float
        Largest excess pressure of the air behind the contact [Pa].
    mesh : meshio.Mesh or None
        Fields under the roller (`results.field_mesh`).
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
    row_lateral_stresses: tuple[float, ...]
    air_load: float = 0.0
    air_resistance: float = 0.0
    air_excess_behind: float = 0.0
    mesh: "meshio.Mesh | None" = field(default=None, repr=False, compare=False)


class LiftAir(NamedTuple):
    """Pore air of the lifts.

    Parameters
    ----------
    pore_air : PoreAir
        Pore air with its permeability.
    coupled : bool
        True if the deformation of a pass yields to the air.
    """

    pore_air: PoreAir
    coupled: bool = False


class SectionProfile(NamedTuple):
    """Rows of a section of equal height, from the base upwards, arrays of shape (rows,).

    Parameters
    ----------
    heights : ndarray
        Heights [m].
    density_ratios : ndarray
        Density ratios [-].
    lateral_stresses : ndarray
        Lateral stress at rest, compression positive [Pa].
    """

    heights: Array
    density_ratios: Array
    lateral_stresses: Array


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

    def profile_at(self, density_ratio: float) -> SectionProfile:
        """Interpolate the rows behind the roller between the lifts at a mean density ratio [-].

        Parameters
        ----------
        density_ratio : float
            Mean density ratio [-]; below the first lift uniform loose mix enters, above the last its rows remain.
        """
        means = np.append(self.lifts[0].density_before, self.values("density_ratio"))
        place = int(np.clip(np.searchsorted(means, density_ratio), 1, len(self.lifts)))
        share = float(np.clip((density_ratio - means[place - 1]) / (means[place] - means[place - 1]), 0.0, 1.0))
        after = np.array(_equal_rows(self.lifts[place - 1]))
        if place > 1:
            before = np.array(_equal_rows(self.lifts[place - 2]))
        else:
            before = np.multiply.outer([after[0, 0], means[0], 0.0], np.ones(PROFILE_ROWS))
        return SectionProfile(*((1 - share) * before + share * after))


def simulate_lifts(
    problem: FormingProblem,
    friction: float,
    rate_factor: float,
    density_ratio: float,
    *,
    thickness: float,
    increments: int,
    air: LiftAir | None = None,
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
    air : LiftAir, optional
        Pore air, whose forces at the speed of the cart are added to the records.
    report : callable
        Called with a line of text after each lift.

    Returns
    -------
    LiftSequence
        Without the lifts after one that has no steady state.
    """
    lifts: list[LumpedLift] = []
    steps = _lifts(problem, friction, rate_factor, (thickness, increments), air)
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


def lift_thickness(machine: FormingMachine, make_up: Array, share: float) -> float:
    """Return the thickness of lumped lifts [m].

    It is a share of the bite at the nip angle, or of a tenth of the feed if that is less. Strokes with a larger make-up
    are not lumped: the lifts of the share `MIDDLE_SHARE` have their mean make-up.

    Parameters
    ----------
    machine : FormingMachine
        Machine with its nip angle.
    make_up : ndarray
        Thickness of the mix fed before each stroke [m], not all 0.
    share : float
        Share [-].
    """
    single = float(make_up[make_up > 0].mean()) / MIDDLE_SHARE
    return share * min(machine.max_bite, max(float(make_up.sum()) / LIFTS_MIN, single))


def _lifts(
    problem: FormingProblem, friction: float, rate_factor: float, lumping: tuple[float, int], air: LiftAir | None
) -> Iterator[LumpedLift]:
    """Yield lifts one after the other, of a thickness [m] and on a number of elements per contact length."""
    thickness, increments = lumping
    machine = problem.machine
    material = replace(problem.material, fed_density_ratio=problem.feed.density_ratio)
    filling = replace(material, fed_density_ratio=problem.fill.density_ratio)
    state = fresh_layer(filling, np.full(FILL_ROWS, problem.fill.height / FILL_ROWS))
    while True:
        fed = thickness
        if state.height + thickness - machine.height > machine.max_bite:
            fed = 0.0  # a fill above the lowest generatrix, or elastic recovery: pressed alone
        raised = state.with_lift(fed, material) if fed else state
        while raised.height <= machine.height:  # lifts in a mould that is not full
            raised = raised.with_lift(thickness, material)
        bite = raised.height - machine.height
        roller = Roller(machine.roller_radius, indentation=bite, friction=friction, rolling="free", profile="deformed")
        speed = _speed_of_rate(problem, material, raised, bite, rate_factor)
        passed = roll(
            Layer(raised.height), roller, material, speed,
            fed_layer=raised, increments=increments, steady_tolerance=STEADY_TOLERANCE,
        )  # fmt: skip
        passed = _with_closed_energy(passed)
        record = _lift(passed, raised, fed)
        yield record if air is None else _with_air(record, passed, air, machine.cart_speed)
        state = passed.exit


def _with_closed_energy(passed: CompactionContactResult) -> CompactionContactResult:
    """Return the pass after further travel until its energy closes, or the mix at its exit has left the last jump."""
    rolling = passed.solution
    height = rolling.steps[-1].bottom_height
    count = int(np.ceil(SETTLING_SHARE * height / rolling.frame.step))
    rolling.solver.tolerance = FINAL_TOLERANCE
    for _ in range(SETTLINGS_MAX):
        if (passed.work_residual or 0.0) < ENERGY_TOLERANCE:
            break
        for _ in range(count):
            rolling.advance(height, FINAL_DAMPING_RATIO * DAMPING)
        result = build_result(rolling, passed.layer, passed.roller, passed.material, passed.speed)
        estimates = {name: getattr(passed, name) for name in ("error", "error_parts", "relaxation")}
        passed = replace(result, **estimates)
    return passed


def _with_air(lift: LumpedLift, passed: CompactionContactResult, air: LiftAir, speed: float) -> LumpedLift:
    """Return a record with the pore air of its pass at a speed [m/s]."""
    if air.coupled:
        contact = roll_coupled(passed, air.pore_air, speed)
        under, pressure = RollerAir(contact.rolling, air.pore_air), contact.pressure
        behind = contact.largest_excess_behind
        load, resistance = contact.load - passed.load, contact.resistance - passed.resistance
    else:
        under = RollerAir(passed.solution, air.pore_air)
        pressure = under.pressure(speed)
        behind, (load, resistance) = under.largest_excess_behind(pressure), under.forces(pressure)
    assert lift.mesh is not None  # of every pass
    points = under.at_points(pressure)
    lift.mesh.cell_data["air_pressure"] = [points.reshape(len(lift.mesh.cells[0].data), -1).mean(axis=1)]
    return replace(lift, air_load=load, air_resistance=resistance, air_excess_behind=behind)


def _speed_of_rate(
    problem: FormingProblem, material: Compaction, raised: LayerState, bite: float, rate_factor: float
) -> float:
    """Return the speed [m/s] at which the yield pressure has a rate factor; that of the cart without rate effect."""
    machine, m = problem.machine, material.rate_sensitivity
    if not m or rate_factor < 1 + RATE_ROUNDING:
        return machine.cart_speed
    factor = rate_factor_at(material, machine.roller_radius, raised.height, bite, machine.cart_speed, raised)
    return machine.cart_speed * float(np.expm1((rate_factor - 1) / m) / np.expm1((factor - 1) / m))


def _lift(passed: CompactionContactResult, raised: LayerState, thickness: float) -> LumpedLift:
    """Return the record of a pass."""
    state, error = passed.exit, passed.error
    assert error is not None  # the engine estimates its error
    tops = np.cumsum(state.heights)
    ratio = state.points.density_ratio
    return LumpedLift(
        thickness=thickness,
        bite=passed.indentation,
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
        row_lateral_stresses=tuple((-state.points.stress[:, [0, 2]].mean(axis=1)).tolist()),
        mesh=field_mesh(passed),
    )


def _equal_rows(lift: LumpedLift) -> SectionProfile:
    """Return rows of equal height behind a lift, by the means of its own rows."""
    heights = np.array(lift.row_heights)
    tops = np.append(0.0, np.cumsum(heights))
    edges = np.linspace(0.0, tops[-1], PROFILE_ROWS + 1)

    def means(values: tuple[float, ...]) -> Array:
        return np.diff(np.interp(edges, tops, np.append(0.0, np.cumsum(heights * values)))) / np.diff(edges)

    return SectionProfile(np.diff(edges), means(lift.row_density_ratios), means(lift.row_lateral_stresses))


def _mean(values: Array, tops: Array, low: float, high: float) -> float:
    """Return the mean of row values between two shares of the height."""
    bounds = np.clip(np.append(0.0, tops), low * tops[-1], high * tops[-1])
    return float(np.diff(bounds) @ values / (bounds[-1] - bounds[0]))
