"""Forming process in two dimensions: the feed of many strokes lumped into 10 to 20 lifts, and integrals over strokes.

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

Load and resistance of a roller row are sums over the strokes of the columns:

    P_row = sum_n P(k_n) dz_n,    F_row = v_form T sum_n (F/t)(k_n) t_n

The strokes n have the mean density k_n, the length dz_n along the roller and the make-up t_n of the columns: the mean
density follows from the balance of mix, whatever the model. P and F/t come from lumped lifts as functions of the mean
density, the first at that behind a stroke, the second at the mean of both sides. Between lifts their logarithms are
interpolated; beyond the last lift they are extrapolated, and the share of the result that is extrapolated is stated.

P and F/t are extrapolated linearly in the thickness of the lifts to t_n at every density. Errors, added as independent
ones: the larger difference to a power law of the thickness and, of three, to a parabola; the finest mesh less the limit
of vanishing elements, of first order in 1/increments; without other meshes the estimate of the engine.

The excess pressure of the pore air is in proportion to the mix that a pass displaces, as long as its flow is linear:

    P_air(t_n) = P_air(t) t_n/t,    F_air/t_n = (F_air/t) t_n/t

Both are taken from the thinnest lifts; the error is the difference to the thickest, and to the other meshes.

Fields of a process are rectangles in z, along the roller, and y, the height. In two dimensions the rows of a section
are those of the lumped lifts at its mean density. Frame n shows the mould after the n-th stroke since its start: the
first section has had n strokes and lies farthest from the empty mould, and loose fill follows it.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from compact.engines.compaction.engine import CompactionContactResult, build_result, field_mesh, roll
from compact.engines.compaction.layer_state import fresh_layer, rate_factor_at
from compact.engines.compaction.rolling import DAMPING, FINAL_DAMPING_RATIO
from compact.engines.compaction.steady_search import FINAL_TOLERANCE
from compact.engines.pore_air.coupled_rolling import roll_coupled
from compact.engines.pore_air.steady_flow import RollerAir
from compact.engines.process.forming import FormingMachine
from compact.engines.process.roller_row import RollerRow, confined_stress
from compact.engines.process.section import QUARTER, FormingProblem, SectionState, mean_over_height
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
FRAMES_MAX = 60  # [-], frames of a series; later strokes are shown at equal intervals
FILL_SHARE = 0.15  # [-], length of the fill shown in front of the roller over that of the roller
RATE_ROUNDING = 1e-12  # [-], rate factor less 1 below which the speed does not matter


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
    rows : tuple of (height, density_ratio, lateral_stress)
        Rows behind the roller from the base upwards [m, -, Pa], at rest.
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
    rows: tuple[tuple[float, ...], ...]
    air_load: float = 0.0
    air_resistance: float = 0.0
    air_excess_behind: float = 0.0
    mesh: Any = field(default=None, repr=False, compare=False)


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
        slope, inside = np.diff(np.log(force)) / np.diff(ratio), np.interp(density, ratio, np.log(force))
        below, above = np.minimum(density - ratio[0], 0.0), np.maximum(density - ratio[-1], 0.0)
        return np.exp(inside + slope[0] * below + slope[-1] * above)

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


def simulate_lifts(
    problem: FormingProblem,
    friction: float,
    rate_factor: float,
    density_ratio: float,
    *,
    thickness: float,
    increments: int,
    air: LiftAir | None = None,
    report: Callable[[str], None] = lambda _: None,
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
    lifts, stopped, machine = list[LumpedLift](), "", problem.machine
    material = replace(problem.material, fed_density_ratio=problem.feed.density_ratio)
    filling = replace(material, fed_density_ratio=problem.fill.density_ratio)
    state = fresh_layer(filling, np.full(FILL_ROWS, problem.fill.height / FILL_ROWS))
    radius, m = machine.roller_radius, material.rate_sensitivity
    try:
        while not lifts or (lifts[-1].density_ratio < density_ratio and len(lifts) < LIFTS_MAX):
            # a fill above the lowest generatrix, or elastic recovery, is pressed alone
            fed = 0.0 if state.height + thickness - machine.height > machine.max_bite else thickness
            raised = state.with_lift(fed, material) if fed else state
            while raised.height <= machine.height:  # lifts in a mould that is not full
                raised = raised.with_lift(thickness, material)
            bite, speed = raised.height - machine.height, machine.cart_speed
            if m and rate_factor >= 1 + RATE_ROUNDING:  # the speed at which the yield pressure has the rate factor
                factor = rate_factor_at(material, radius, raised.height, bite, speed, raised)
                speed *= float(np.expm1((rate_factor - 1) / m) / np.expm1((factor - 1) / m))
            roller = Roller(radius, indentation=bite, friction=friction, rolling="free", profile="deformed")
            accuracy: Any = {"increments": increments, "steady_tolerance": STEADY_TOLERANCE}
            passed = roll(Layer(raised.height), roller, material, speed, fed_layer=raised, **accuracy)
            passed = _with_closed_energy(passed)
            lifts.append(_lift(passed, raised.density_ratio, fed, air, machine.cart_speed))
            report(f"lift {len(lifts)} of {thickness * 1e3:.3g} mm: mean density ratio {lifts[-1].density_ratio:.3f}")
            state = passed.exit
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


def _with_closed_energy(passed: CompactionContactResult) -> CompactionContactResult:
    """Return the pass after further travel until its energy closes, or the mix at its exit has left the last jump."""
    rolling, height = passed.solution, passed.solution.steps[-1].bottom_height
    count = int(np.ceil(SETTLING_SHARE * height / rolling.frame.step))
    rolling.solver.tolerance = FINAL_TOLERANCE
    for _ in range(SETTLINGS_MAX):
        if (passed.work_residual or 0.0) < ENERGY_TOLERANCE:
            break
        for _ in range(count):
            rolling.advance(height, FINAL_DAMPING_RATIO * DAMPING)
        result = build_result(rolling, passed.layer, passed.roller, passed.material, passed.speed)
        passed = replace(result, error=passed.error, error_parts=passed.error_parts, relaxation=passed.relaxation)
    return passed


def _lift(
    passed: CompactionContactResult, density_before: float, thickness: float, air: LiftAir | None, speed: float
) -> LumpedLift:
    """Return the record of a pass, with its pore air at a speed [m/s]."""
    state, error, mesh = passed.exit, passed.error, field_mesh(passed)
    assert error is not None  # the engine estimates its error
    ratio, of_air = state.points.density_ratio, {}
    if air is not None:
        coupled = roll_coupled(passed, air.pore_air, speed) if air.coupled else None
        under = RollerAir(passed.solution if coupled is None else coupled.rolling, air.pore_air)
        pressure = under.pressure(speed) if coupled is None else coupled.pressure
        load, resistance = under.forces(pressure)
        if coupled is not None:
            load, resistance = coupled.load - passed.load, coupled.resistance - passed.resistance
        excess = under.largest_excess_behind(pressure)
        of_air = {"air_load": load, "air_resistance": resistance, "air_excess_behind": excess}
        under.add_field(mesh, pressure)
    same = ("load", "resistance", "peak_pressure", "work_residual", "mass_residual")
    return LumpedLift(
        thickness=thickness, bite=passed.indentation, load_error=error[0], resistance_error=error[1],
        density_before=density_before, density_ratio=passed.exit_density_ratio,
        bottom_density_ratio=mean_over_height(state.heights, ratio, 0.0, QUARTER),
        top_density_ratio=mean_over_height(state.heights, ratio, 1 - QUARTER, 1.0),
        overpressed_height=float(state.heights[ratio > 1].sum()), surface=passed.exit_height,
        rows=tuple(zip(state.heights, ratio, -state.points.stress[:, [0, 2]].mean(axis=1), strict=True)),
        mesh=mesh, **{name: getattr(passed, name) for name in same}, **of_air,
    )  # fmt: skip


@dataclass(frozen=True)
class Estimate:
    """Number with its error.

    Parameters
    ----------
    value : float
        Value in its unit.
    lumping_error, mesh_error : float
        Relative errors by the thickness of the lifts and by the mesh [-].
    extrapolated_share : float
        Share of the value from strokes denser than the densest lift [-].
    """

    value: float
    lumping_error: float
    mesh_error: float
    extrapolated_share: float

    @property
    def error(self) -> float:
        """Relative error of both causes [-]."""
        return float(np.hypot(self.lumping_error, self.mesh_error))


NO_FORCE = Estimate(0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class TwoDimensionalRow:
    """Roller row in two dimensions.

    Parameters
    ----------
    row : RollerRow
        Strokes of the columns.
    sequences : tuple of LiftSequence
        Lifts; those with the least increments have different thicknesses, two or more, those of one thickness
        different increments.
    rate_scale : float
        Rate factor of the strokes over that of the lifts [-], to which their forces are in proportion.
    air_scale : float
        Speed of the strokes over that of the lifts [-], to which the forces of their pore air are in proportion.
    """

    row: RollerRow
    sequences: tuple[LiftSequence, ...]
    rate_scale: float = 1.0
    air_scale: float = 1.0

    def __post_init__(self) -> None:
        if len(self.lumpings) < 2:
            raise ValueError(f"`sequences` must have two thicknesses on one mesh at least, got {len(self.lumpings)}")

    @property
    def lumpings(self) -> tuple[LiftSequence, ...]:
        """Sequences with the least increments, the thinnest lifts first."""
        least = min(sequence.increments for sequence in self.sequences)
        found = [sequence for sequence in self.sequences if sequence.increments == least]
        return tuple(sorted(found, key=lambda sequence: sequence.thickness))

    @property
    def meshes(self) -> tuple[LiftSequence, ...]:
        """Sequences of the thickness that has most meshes, the finest mesh first."""
        thicknesses = [sequence.thickness for sequence in self.sequences]
        most = max(thicknesses, key=thicknesses.count)
        found = [sequence for sequence in self.sequences if sequence.thickness == most]
        return tuple(sorted(found, key=lambda sequence: -sequence.increments))

    @property
    def load(self) -> Estimate:
        """Load of the roller [N]."""
        return self._estimate("load")

    @property
    def resistance(self) -> Estimate:
        """Resistance of the roller [N]; 0 of a mould at rest, whose work per stroke is not that of the row."""
        return self._estimate("resistance")

    @property
    def air_load(self) -> Estimate:
        """Load by the excess pressure of the pore air [N]; 0 without air."""
        return self._air_estimate("air_load")

    @property
    def air_resistance(self) -> Estimate:
        """Resistance by the excess pressure of the pore air [N]; 0 without air, and of a mould at rest."""
        return self._air_estimate("air_resistance")

    @property
    def air_excess_behind(self) -> float:
        """Largest excess pressure behind the contact of the thinnest lifts [Pa], a tensile stress of the skeleton."""
        return float(self.lumpings[0].values("air_excess_behind").max()) * self.air_scale

    @property
    def load_centre(self) -> float:
        """Centre of the load from the edge at the empty mould [m]."""
        return self.row.centre_of(self.at_strokes("load", self.lumpings))

    @property
    def skew_moment(self) -> float:
        """Moment of the load about the middle of the roller [N m], + towards the finished product."""
        return self.load.value * (self.load_centre - self.row.problem.machine.roller_length / 2)

    @property
    def specific_work(self) -> float:
        """Work of the roller per volume of the product [J/m3]; nan of a mould at rest."""
        return self.row.work_per_volume(self.resistance.value)

    def of_product(self, name: str) -> float:
        """Return a field of the thinnest lifts at the density of the product, or behind the last lift if that is less.

        Parameters
        ----------
        name : str
            Field of `LumpedLift`, such as "bottom_density_ratio".
        """
        thinnest = self.lumpings[0]
        ratio = thinnest.values("density_ratio")
        return float(np.interp(self.row.product_density_ratio, ratio, thinnest.values(name)))

    def strip_stress_ratio(self) -> float:
        """Return the confined stress of the bottom's density over 2 P/(pi h0), that of a line load on the base [-]."""
        problem, lift = self.row.problem, self.lumpings[0].lifts[-1]
        strip = 2 * self.rate_scale * lift.load / (np.pi * problem.machine.height)
        stress = confined_stress(problem.material, np.array([lift.bottom_density_ratio]), self.row.history.rate_factor)
        return float(stress[0]) / strip

    def at_strokes(self, name: str, sequences: Sequence[LiftSequence], degree: int = 1) -> Array:
        """Return P or F/t of every stroke [N/m, N/m2], extrapolated in the thickness of the lifts to its make-up.

        Parameters
        ----------
        name : {"load", "resistance"}
            Force.
        sequences : sequence of LiftSequence
            One or more sequences of different thicknesses.
        degree : int
            Degree of the polynomial in the thickness, less than the number of sequences; 0 for a power law.
        """
        density, made_up = self._densities(name), self.row.history.make_up
        table = self.rate_scale * np.array([sequence.at(name, density) for sequence in sequences])
        if len(sequences) == 1:
            return table[0]
        thickness = np.array([sequence.thickness for sequence in sequences])
        if not degree:
            slope, level = np.polyfit(np.log(thickness), np.log(table), 1)
            return np.asarray(np.exp(level + slope * np.log(np.where(made_up > 0, made_up, thickness[0]))))
        powers = np.arange(degree, -1, -1)[:, None]
        return np.sum(np.polyfit(thickness, table, degree) * made_up**powers, axis=0)

    def _densities(self, name: str) -> Array:
        """Mean density ratio of every stroke to which a force belongs [-]: behind it, or the mean of both sides."""
        states = np.array([state.density_ratio for state in self.row.history.states])
        return states[1:] if name.endswith("load") else (states[:-1] + states[1:]) / 2

    def _weights(self, name: str) -> Array:
        """Weights of the strokes in a sum: their lengths [m], or the mix that they press over an advance [m2]."""
        if name.endswith("load"):
            return self.row.lengths
        machine = self.row.problem.machine
        shares = machine.stroke_shares if machine.strokes is None else 1.0
        return np.asarray(machine.advance * self.row.history.make_up * shares)

    def _estimate(self, name: str) -> Estimate:
        lumpings, meshes, weights = self.lumpings, self.meshes, self._weights(name)
        forces = self.at_strokes(name, lumpings)
        value = float(forces @ weights)
        if value == 0:
            return NO_FORCE
        others = [self.at_strokes(name, lumpings, degree) for degree in ((0, 2) if len(lumpings) > 2 else (0,))]
        lumping = max(abs(float(other @ weights) / value - 1) for other in others)
        mesh_limit, mesh = 1.0, float(np.average(lumpings[0].values(f"{name}_error"), weights=lumpings[0].values(name)))
        if len(meshes) > 1:
            sums = [float(self.at_strokes(name, [sequence]) @ weights) for sequence in meshes]
            limit = float(np.polyfit([1 / sequence.increments for sequence in meshes], sums, 1)[1])
            mesh_limit, mesh = limit / sums[-1], abs(limit / sums[0] - 1)
        beyond = self.row.history.density_ratio > min(each.values("density_ratio").max() for each in lumpings)
        return Estimate(value * mesh_limit, lumping, mesh, float(forces[beyond] @ weights[beyond]) / value)

    def _air_estimate(self, name: str) -> Estimate:
        """Return a force of the air by the thinnest lifts, with the differences to the thickest and between meshes."""
        weights = self.row.history.make_up * self._weights(name) * self.air_scale
        density = self._densities(name)
        sequences = self.lumpings[0], self.lumpings[-1], self.meshes[0], self.meshes[-1]
        value, thickest, finest, coarsest = (float(each.at(name, density) @ weights) for each in sequences)
        return Estimate(value, abs(thickest / value - 1), abs(coarsest / finest - 1), 0.0) if value else NO_FORCE


def process_frames(row: RollerRow, lifts: LiftSequence | None = None) -> Iterator[tuple[float, "meshio.Mesh"]]:
    """Yield the number of strokes since the start, and the fields with the rows of `section_rows`.

    Cell data: density ratio [-], lateral stress at rest [Pa], number of strokes.
    """
    import meshio

    machine, states, count = row.problem.machine, row.history.states, row.history.count
    for number in np.unique(np.linspace(1, count, min(count, FRAMES_MAX)).round().astype(int)).tolist():
        if machine.strokes is not None:
            pieces = [(0.0, machine.roller_length, number, states[number])]
        else:
            edges = machine.edges
            pieces = [(float(edges[n - 1]), float(edges[n]), n, states[n]) for n in range(1, number + 1)]
            pieces.insert(0, (-FILL_SHARE * machine.roller_length, 0.0, 0, states[0]))
        points, values = [], []
        for low, high, strokes, state in pieces:
            bottom = 0.0
            for height, ratio, stress in section_rows(state, lifts):
                top = bottom + height
                points += [(low, bottom, 0.0), (high, bottom, 0.0), (high, top, 0.0), (low, top, 0.0)]
                values.append((ratio, stress, float(strokes)))
                bottom = top
        names, columns = ("density_ratio", "lateral_stress", "strokes"), np.array(values).T
        data = {name: [column] for name, column in zip(names, columns, strict=True)}
        cells = [("quad", np.arange(len(points)).reshape(-1, 4))]
        yield float(number), meshio.Mesh(np.array(points), cells, cell_data=data)


def section_rows(state: SectionState, lifts: LiftSequence | None) -> Iterator[tuple[float, float, float]]:
    """Yield height [m], density ratio [-] and lateral stress at rest [Pa] of the rows of a section from the base up.

    They are its layers, or those of lumped lifts at the mean density of the section.
    """
    if lifts is None:
        yield from ((column.height, column.density_ratio, column.lateral_stress) for column in state.columns)
    else:
        yield from zip(*lifts.profile_at(state.density_ratio).tolist(), strict=True)
