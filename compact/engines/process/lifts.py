"""Lumped lifts of a forming process: the feed of many strokes as 10 to 20 passes of finite elements in two dimensions.

Every stroke starts from the whole state that the previous one has left, so that strokes cannot be computed singly and
interpolated. The feed is therefore lumped. Each lift of the thickness t, several times the make-up of a stroke, is
spread over the section and pressed down to the lowest generatrix by one pass of the engine "compaction". Density and
stress of the rows behind the pass are the initial state of the next one. The rate of compaction is that of the strokes:
the speed of each pass is chosen so that the yield pressure has their rate factor.

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

from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from compact.engines.compaction.engine import CompactionContactResult, build_result, field_mesh, roll
from compact.engines.compaction.layer_state import fresh_layer, rate_factor_at
from compact.engines.compaction.rolling import DAMPING, FINAL_DAMPING_RATIO, ROLLING_TOLERANCE
from compact.engines.pore_air import NO_FORCES
from compact.engines.pore_air.coupled_rolling import roll_coupled
from compact.engines.pore_air.steady_flow import RollerAir
from compact.engines.process.forming import FormingMachine
from compact.engines.process.kneading import GYRATION_WORK
from compact.engines.process.strokes import QUARTER, FormingProblem, confined_stress, confined_work, mean_over_height
from compact.material.laws import MEASURED_DENSITY_RATIO, Compaction
from compact.material.pore_air import PoreAir
from compact.numerics import Array
from compact.rolling_contact import Layer, Roller

ProcessDetail = Literal["columns", "deep"]
FILL_ROWS = 40  # [-], rows of the fill, resampled to those of the mesh by the engine
STEADY_TOLERANCE = 1e-2  # [-], of load, resistance and density of a pass; small against the error of lumping
LIFTS_MIN = 10  # [-], lifts of a sequence at least, so that those of a thin product are thinner
MIDDLE_SHARE = 0.75  # [-], thickness of the lifts of the middle over their largest
ENDS = slice(2), slice(-4, None)  # first and last lifts whose slope extrapolates; that of two depends on their number
PROFILE_ROWS = 40  # [-], rows of equal height of a profile between two lifts
WAVE_SHARE = 0.5  # [-], bow wave over the bite beyond which a lift no longer stands for strokes of its own wave
LIFTS_MAX = 40  # [-], lifts of a sequence
ENERGY_TOLERANCE = 1e-2  # [-], residual of the energy of a pass above which it rolls on
SETTLING_SHARE = 1 / 3  # [-], of the height, travel after which the energy is evaluated again
SETTLINGS_MAX = 8  # [-], of a pass; the wave relaxes over some ten contact lengths, 1.6 times the height
RATE_ROUNDING = 1e-12  # [-], rate factor less 1 below which the speed does not matter
CASES: dict[ProcessDetail, tuple[tuple[float, int], ...]] = {  # share and elements per contact length of the sequences
    "columns": (),
    "deep": ((0.7, 4), (0.9, 4)),  # the longer one first; on 3 elements the energy of a lift is open by more than 1 %
}


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
    saturated_height : float
        Height beyond the measured end of the curve, k > 0.99 [m].
    surface : float
        Height behind the roller [m].
    peak_pressure : float
        Largest pressure [Pa].
    work_residual, mass_residual : float
        Relative residuals of the balances of the pass [-].
    rows : tuple of (height, density_ratio, lateral_stress)
        Rows behind the roller from the base upwards [m, -, Pa], at rest.
    air_load, air_resistance : float
        Changes of load and resistance by the pore air [N/m]; 0 without air.
    air_excess_behind : float
        Largest excess pressure of the air behind the contact [Pa].
    gyrations : float
        Gyrations of the section by the shear work of all passes so far [-], see `kneading`.
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
    saturated_height: float
    surface: float
    peak_pressure: float
    work_residual: float
    mass_residual: float
    rows: tuple[tuple[float, ...], ...]
    air_load: float = 0.0
    air_resistance: float = 0.0
    air_excess_behind: float = 0.0
    gyrations: float = 0.0
    mesh: Any = field(default=None, repr=False, compare=False)


@dataclass(frozen=True)
class LiftSequence:
    """Lifts of one thickness until a density.

    Parameters
    ----------
    thickness : float
        Thickness t of a lift [m].
    increments : int
        Elements per contact length; two more for a lift whose energy stays open on them.
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

    def at(self, name: str, density: Array) -> Array:
        """Interpolate a force at mean density ratios [-], linearly in the logarithm, and extrapolate it.

        A load belongs to the density behind a lift. A resistance belongs to the mean of both sides and is over the
        thickness of the lift; a section pressed without a lift has no work per mix. A force of the air, which is not
        extrapolated, is over the thickness of the sequence.

        Parameters
        ----------
        name : {"load", "resistance", "air_load", "air_resistance"}
            Force.
        density : ndarray
            Mean density ratios [-], that behind a stroke for a load, else that of both sides.

        Returns
        -------
        ndarray
            P [N/m], F/t and P_air/t [N/m2], or F_air/t^2 [N/m3].
        """
        ratio, force = self.values("density_ratio"), self.values(name)
        if name.endswith("resistance"):
            thickness = self.values("thickness")
            fed = thickness > 0
            ratio, force = ((ratio + self.values("density_before")) / 2)[fed], force[fed] / thickness[fed]
        if name.startswith("air"):
            return np.interp(density, ratio, force) / self.thickness
        if len(ratio) == 1:
            return np.full(len(density), force[0])
        inside = np.interp(density, ratio, np.log(force))
        below, above = np.minimum(density - ratio[0], 0.0), np.maximum(density - ratio[-1], 0.0)
        first, last = (np.polyfit(ratio[part], np.log(force[part]), 1)[0] for part in ENDS)
        return np.exp(inside + first * below + last * above)

    @property
    def largest_work_residual(self) -> float:
        """Largest residual of the energy balance of a pass [-]."""
        return float(self.values("work_residual").max())

    def profile_at(self, density_ratio: float) -> Array:
        """Interpolate the rows behind the roller between the lifts at a mean density ratio [-].

        Below the first lift uniform loose mix enters, above the last its rows remain.

        Returns
        -------
        ndarray, shape (3, rows)
            Heights, all equal [m], density ratios [-] and lateral stresses at rest, compression positive [Pa], from
            the base upwards.
        """

        def equal_rows(lift: LumpedLift) -> Array:
            heights, *values = np.array(lift.rows).T
            tops = np.append(0.0, np.cumsum(heights))
            edges = np.linspace(0.0, tops[-1], PROFILE_ROWS + 1)
            sums = (np.interp(edges, tops, np.append(0.0, np.cumsum(heights * each))) for each in values)
            return np.array([np.diff(edges), *(np.diff(each) / np.diff(edges) for each in sums)])

        means = np.append(self.lifts[0].density_before, self.values("density_ratio"))
        place = int(np.clip(np.searchsorted(means, density_ratio), 1, len(self.lifts)))
        share = float(np.clip((density_ratio - means[place - 1]) / (means[place] - means[place - 1]), 0.0, 1.0))
        after = equal_rows(self.lifts[place - 1])
        loose = np.multiply.outer([after[0, 0], means[0], 0.0], np.ones(PROFILE_ROWS))
        return (1 - share) * (loose if place == 1 else equal_rows(self.lifts[place - 2])) + share * after


class KnownLifts(NamedTuple):
    """Lumped lifts that are computed already, for processes that differ in their speeds alone.

    Parameters
    ----------
    sequences : tuple of LiftSequence
        Lifts of different thicknesses, the thinnest first.
    rate_factor : float
        Factor of their yield pressure [-]; forces of other strokes are in proportion to theirs.
    cart_speed : float
        Speed of the cart [m/s], to which the forces of their pore air are in proportion.
    """

    sequences: tuple[LiftSequence, ...]
    rate_factor: float
    cart_speed: float

    @property
    def bare(self) -> "KnownLifts":
        """The lifts without their fields under the roller."""
        bare = (replace(each, lifts=tuple(replace(lift, mesh=None) for lift in each.lifts)) for each in self.sequences)
        return self._replace(sequences=tuple(bare))

    def to_json(self) -> dict[str, Any]:
        """Return the content of a JSON file, without the fields under the roller."""
        return {**self._asdict(), "sequences": [asdict(each) for each in self.bare.sequences]}


def simulate_lifts(
    problem: FormingProblem,
    friction: float,
    rate_factor: float,
    density_ratio: float,
    *,
    thickness: float,
    increments: int,
    air: tuple[PoreAir, bool] | None = None,
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
    air : (PoreAir, bool), optional
        Pore air, whose forces at the speed of the cart are added to the records, and True if the deformation of a pass
        yields to it.

    Returns
    -------
    LiftSequence
        Without the lifts after one that has no steady state.
    """
    lifts, stopped, height, wave = list[LumpedLift](), "", problem.machine.height, np.inf
    material = replace(problem.material, fed_density_ratio=problem.feed.density_ratio)
    filling = replace(material, fed_density_ratio=problem.fill.density_ratio)
    state = fresh_layer(filling, np.full(FILL_ROWS, problem.fill.height / FILL_ROWS))
    kneaded = gained = 0.0
    while not lifts or (lifts[-1].density_ratio < density_ratio and len(lifts) < LIFTS_MAX):
        # a fill above the lowest generatrix, or elastic recovery, is pressed alone
        fed = 0.0 if state.height + thickness - height > problem.machine.max_bite else thickness
        raised = state.with_lift(fed, material) if fed else state
        while raised.height <= height:  # lifts in a mould that is not full
            raised = raised.with_lift(thickness, material)
        kneaded *= state.density_ratio * state.height / (raised.density_ratio * raised.height)  # of all its grains
        if problem.kneading is not None:  # at the middle of the pass, if it gains as much as the one before
            slope = problem.material.heckel_slope * float(problem.kneading.slope_factor(kneaded + gained / 2))
            material = replace(material, heckel_slope=slope)
        try:
            passed = _passed(problem.machine, material, raised, friction, rate_factor, increments)
        except (RuntimeError, ValueError) as error:  # no steady state, or more mix than fits
            if not lifts:
                raise
            stopped = str(error).partition(";")[0]
            break
        lift = _lift(passed, raised.density_ratio, fed, problem.machine.cart_speed, air)
        densities = lift.density_before, lift.density_ratio
        gained = gyrations_of(material, densities, lift.surface, lift.resistance, rate_factor)
        kneaded += gained
        lifts.append(replace(lift, gyrations=kneaded))
        state, before, wave = passed.exit, wave, passed.bow_wave
        if wave > max(before, WAVE_SHARE * passed.indentation):
            stopped = f"from lift {len(lifts)} on the mix heaps up, in a wave of {wave * 1e3:.1f} mm"
            break
    return LiftSequence(thickness, increments, tuple(lifts), stopped)


def _passed(machine, material, raised, friction, factor, increments):
    """Return the pass of the roller over a raised section, at the speed at which its yield has the rate factor.

    A pass whose energy does not close rolls on, and then again on a finer mesh.
    """
    bite, speed, m = raised.height - machine.height, machine.cart_speed, material.rate_sensitivity
    if m and factor >= 1 + RATE_ROUNDING:
        own = rate_factor_at(material, machine.roller_radius, raised.height, bite, speed, raised)
        speed *= float(np.expm1((factor - 1) / m) / np.expm1((own - 1) / m))
    roller = Roller(machine.roller_radius, indentation=bite, friction=friction, rolling="free", profile="deformed")
    accuracy: dict[str, Any] = {"steady_tolerance": STEADY_TOLERANCE, "fed_layer": raised}
    with threadpool_limits(1):  # threads of a factorisation wait for one another
        for elements in (increments, increments + 2):  # what settling leaves open is of the mesh
            passed = roll(Layer(raised.height), roller, material, speed, increments=elements, **accuracy)
            for _ in range(SETTLINGS_MAX):
                if (passed.work_residual or 0.0) < ENERGY_TOLERANCE:
                    return passed
                passed = _settled(passed)
    return passed


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


def _settled(passed: CompactionContactResult) -> CompactionContactResult:
    """Return the pass after further travel, in which the mix at its exit leaves the last jump behind."""
    rolling, height = passed.solution, passed.solution.steps[-1].bottom_height
    rolling.solver.tolerance = ROLLING_TOLERANCE
    for _ in range(int(np.ceil(SETTLING_SHARE * height / rolling.frame.step))):
        rolling.advance(height, FINAL_DAMPING_RATIO * DAMPING)
    result = build_result(rolling, passed.layer, passed.roller, passed.material, passed.speed)
    return replace(result, error=passed.error, error_parts=passed.error_parts, relaxation=passed.relaxation)


def _lift(passed, before, thickness, speed, air):
    """Return the `LumpedLift` of a pass on mix of a mean density ratio before, with its pore air at a speed [m/s]."""
    state, error, mesh, forces = passed.exit, passed.error or (0.0, 0.0), field_mesh(passed), NO_FORCES
    ratio = state.points.density_ratio
    if air is not None:
        pore_air, coupled = air
        found = roll_coupled(passed, pore_air, speed) if coupled else None
        under = RollerAir(passed.solution if found is None else found.rolling, pore_air)
        pressure = under.pressure(speed) if found is None else found.pressure
        forces = under.forces(pressure) if found is None else found.changes
        under.add_field(mesh, pressure)
    same = ("load", "resistance", "peak_pressure", "work_residual", "mass_residual")
    return LumpedLift(
        thickness=thickness, bite=passed.indentation, load_error=error[0], resistance_error=error[1],
        density_before=before, density_ratio=passed.exit_density_ratio,
        bottom_density_ratio=mean_over_height(state.heights, ratio, 0.0, QUARTER),
        top_density_ratio=mean_over_height(state.heights, ratio, 1 - QUARTER, 1.0),
        saturated_height=float(state.heights[ratio > MEASURED_DENSITY_RATIO].sum()), surface=passed.exit_height,
        rows=tuple(zip(state.heights, ratio, -state.points.stress[:, [0, 2]].mean(axis=1), strict=True)),
        mesh=mesh, **{name: getattr(passed, name) for name in same},
        **{f"air_{name}": value for name, value in forces._asdict().items()},
    )  # fmt: skip


def gyrations_of(
    material: Compaction, densities: tuple[float, float], height: float, work: float, rate_factor: float
) -> float:
    """Return the gyrations of a pass [-] by its shear work, the work less that of confined compression.

    The pressure is the vertical stress of confined compression at the mean density ratio behind the pass.

    Parameters
    ----------
    densities : (float, float)
        Mean density ratio before and behind the pass [-].
    height : float
        Height behind the pass [m].
    work : float
        Work per area, the resistance per roller length [N/m].
    rate_factor : float
        Factor of the yield pressure [-].
    """
    before, after = densities
    shear = work / height - confined_work(material, [(1.0, before)], after, rate_factor)
    return max(shear, 0.0) / (GYRATION_WORK * float(confined_stress(material, after, rate_factor)))
