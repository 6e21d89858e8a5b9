"""Forming process of a scene: roller row, sleeves, guides, balances, operating map and printed forces for comparison.

Columns give the load, its spread along the roller and the confined floor of the resistance. The floor is not for
sizing, and the load is a lower estimate: shear and the density over the height need two dimensions. Lumped lifts
compute these, of two thicknesses on one mesh ("quick"), or of three thicknesses and on three meshes ("deep"). Pore air
enters them one-way or coupled; drained mix states its one-way part alone.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np

from compact.analysis.machine_models import cart
from compact.analysis.mix_laws import compaction_material, scene_mix
from compact.analysis.pore_air import AirForces, pore_air_of
from compact.engines.process.forming import Closure, ClosureKind, Feed, Fill, FormingMachine
from compact.engines.process.lifts import (
    MIDDLE_SHARE,
    LiftAir,
    LiftSequence,
    TwoDimensionalRow,
    lift_thickness,
    simulate_lifts,
)
from compact.engines.process.operating_map import DensityCurve, OperatingMap, density_curve
from compact.engines.process.roller_row import FeedSleeve, RollerRow
from compact.engines.process.section import BiteError, FormingProblem, solve_closure
from compact.machine.cart import balance
from compact.material.mix import Mix, bulk_density
from compact.material.pore_air import PoreAir
from compact.numerics import Array
from compact.scene.loader import Scene, SceneError
from compact.verification import published_machine

ProcessDetail = Literal["columns", "quick", "deep"]
MAP_MOULD_SHARES = tuple(2.0 ** (power / 8) for power in range(-16, 17))  # [-], speeds of the map over the scene's
MAP_CART_SHARES = tuple(2.0 ** (power / 8) for power in range(-8, 9))  # [-], likewise
LIFT_SHARES = (MIDDLE_SHARE, 0.9, 0.6)  # [-], of thicknesses of the lifts, see `lift_thickness`; quick: the first two
INCREMENTS = (6, 9, 12)  # [-], elements per contact length of the meshes; quick: the first
CASES: dict[ProcessDetail, tuple[tuple[float, int], ...]] = {  # share and increments of the sequences of lifts
    "columns": (),
    "quick": tuple((share, INCREMENTS[0]) for share in LIFT_SHARES[:2]),
    "deep": (
        *((share, INCREMENTS[0]) for share in LIFT_SHARES), *((LIFT_SHARES[0], count) for count in INCREMENTS[1:]),
    ),
}  # fmt: skip

WORK_LIMIT = 2e-2  # [-], residual of the energy balance of a pass
UNFED_SHARE = 1e-6  # [-], of the product; less missing or surplus mix is rounding
COLUMNS_ERROR = 1e-6  # [-], of the forces; difference of 3, 20 and 80 merged layers
PRINTED_TOLERANCE = 1e-9  # [-], of roller radius and product height of the published machine


class ResistancePart(NamedTuple):
    """Part of the force that moves one cart.

    Parameters
    ----------
    cause : str
        Words.
    force : float or None
        Force [N]; None where columns do not compute it.
    work : float or None
        Work per volume of the product [J/m3]; None likewise, or of a mould at rest.
    """

    cause: str
    force: float | None
    work: float | None


class KnownLifts(NamedTuple):
    """Lumped lifts that are computed already, for processes that differ in their speeds alone.

    Parameters
    ----------
    sequences : tuple of LiftSequence
        Lifts in two dimensions.
    rate_factor : float
        Factor of their yield pressure [-]; forces of other strokes are in proportion to theirs.
    cart_speed : float
        Speed of the cart [m/s], to which the forces of their pore air are in proportion.
    """

    sequences: tuple[LiftSequence, ...]
    rate_factor: float
    cart_speed: float

    def to_json(self) -> dict[str, Any]:
        """Return the content of a JSON file, without the fields under the roller."""
        bare = (replace(each, lifts=tuple(replace(lift, mesh=None) for lift in each.lifts)) for each in self.sequences)
        return {**self._asdict(), "sequences": [asdict(each) for each in bare]}


class PrintedForce(NamedTuple):
    """Printed force, a design value, and the computed one; the Heckel slope of the prior passes through the same point.

    Parameters
    ----------
    name : str
        Words.
    printed, computed : float
        Forces [N].
    causes : tuple of (str, float)
        Parts of the printed force [N], in words; they add up to it.
    """

    name: str
    printed: float
    computed: float
    causes: tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class ProcessStudy:
    """Forming process of a scene with the table [process].

    Parameters
    ----------
    scene : Scene
        Scene.
    detail : {"columns", "quick", "deep"}
        Columns alone, or with lumped lifts in two dimensions.
    report : callable
        Called with a line of text after each lift.
    known : KnownLifts, optional
        Lifts of the same section and mix; without them they are computed.

    Raises
    ------
    SceneError
        If the scene has no such table.
    """

    scene: Scene
    detail: ProcessDetail = "columns"
    report: Callable[[str], None] = field(default=lambda _: None, compare=False)
    known: KnownLifts | None = None

    def __post_init__(self) -> None:
        if self.scene.process is None:
            raise SceneError(
                [f"{self.scene.file}: the table [process] is missing; give the mould's speed, the feed and one closure"]
            )

    @cached_property
    def mix(self) -> Mix:
        """Mix of the scene."""
        return scene_mix(self.scene)

    @cached_property
    def problem(self) -> FormingProblem:
        """Machine, mix and feed."""
        table, machine = self.scene.process, self.scene.machine
        assert table is not None  # required by the constructor
        forming = FormingMachine(
            roller_radius=machine.roller_radius,
            roller_length=machine.roller_length,
            height=self.scene.product.height,
            cart_speed=self.scene.mean_speed,
            stroke_period=self.scene.motion.duration + self.scene.motion.dwell,
            mould_speed=table.mould_speed,
            nip_angle=table.nip_angle,
            strokes=table.strokes,
        )
        if table.fill_height is None or table.fill_density_ratio is None:
            fill = Fill(self.scene.product.height, table.feed_density_ratio, by_sleeve=True)
        else:
            fill = Fill(table.fill_height, table.fill_density_ratio)
        points = table.feed_table or ()
        feed = Feed(
            table.feed_density_ratio, table.feed, table.feed_count or 0,
            tuple(point.position for point in points), tuple(point.relative_thickness for point in points), table.feeds,
        )  # fmt: skip
        return FormingProblem(forming, compaction_material(self.scene, self.mix), fill, feed, table.layers)

    @property
    def closure(self) -> Closure:
        """Condition that determines the feed."""
        table = self.scene.process
        assert table is not None
        kinds: tuple[ClosureKind, ...] = ("gap", "product_density_ratio", "extrusion_pressure")
        kind = next(kind for kind in kinds if getattr(table, kind) is not None)  # a rule of the scene
        return Closure(kind, getattr(table, kind), table.offered_thickness)

    @cached_property
    def row(self) -> RollerRow:
        """Strokes under one roller."""
        return RollerRow(solve_closure(self.problem, self.closure), self.scene.mix.density_ratio)

    @cached_property
    def lifts(self) -> KnownLifts | None:
        """Lumped lifts in two dimensions; None by columns alone or without feed."""
        make_up = self.row.history.make_up
        if not CASES[self.detail] or not make_up.any():
            return None
        if self.known is not None:
            return self.known
        sequences = tuple(
            simulate_lifts(
                self.problem, self.mix.steel_friction, self.row.history.rate_factor, self.row.product_density_ratio,
                thickness=lift_thickness(self.problem.machine, make_up, share), increments=increments,
                air=self.lift_air, report=self.report,
            )
            for share, increments in CASES[self.detail]
        )  # fmt: skip
        return KnownLifts(sequences, self.row.history.rate_factor, self.problem.machine.cart_speed)

    @cached_property
    def two_dimensions(self) -> TwoDimensionalRow | None:
        """Roller row in two dimensions; None by columns alone or without feed."""
        return self._in_two_dimensions(self.row)

    def _in_two_dimensions(self, row: RollerRow) -> TwoDimensionalRow | None:
        if (known := self.lifts) is None:
            return None
        shares = row.history.rate_factor / known.rate_factor, row.problem.machine.cart_speed / known.cart_speed
        return TwoDimensionalRow(row, known.sequences, *shares)

    def row_at(self, speed: float) -> RollerRow:
        """Compute the strokes under one roller at another speed of the cart [m/s], in strokes of the same duration.

        The gap of the feed, or its thickness or pressure, is that of the closure at the mean speed. A place along the
        travel is passed at nearly the same speed in every stroke, so that all strokes on a section have one rate.
        """
        if speed == self.problem.machine.cart_speed:
            return self.row
        problem, factor, history = self.problem.at_speed(speed), self.rate_factor_at(speed), self.row.history
        if self.closure.kind == "extrusion_pressure":
            history = problem.at_pressure(self.closure.value, history.offered, factor)
        else:
            history = problem.with_amount(history.amount, factor)
        return replace(self.row, history=history.within_nip())

    def rate_factor_at(self, speed: float) -> float:
        """Return the factor of the yield pressure [-] of strokes at a speed of the cart [m/s]."""
        return self.problem.at_speed(abs(speed)).rate_factor(self.row.history.mean_bite)

    @cached_property
    def forces(self) -> "StrokeForces":
        """Load and resistance of one roller at the mean speed, by the best model."""
        return self.forces_at(self.problem.machine.cart_speed)

    def forces_at(self, speed: float) -> "StrokeForces":
        """Compute load and resistance of one roller at a speed of the cart [m/s], by the best model."""
        row = self.row_at(speed)
        found = self._in_two_dimensions(row)
        return StrokeForces(row, found, self.problem.feed.strokes == "forward")

    @property
    def pore_air(self) -> PoreAir | None:
        """Pore air with its permeability at the density of [layer], as in `compact run`; None if it is occluded."""
        try:
            return pore_air_of(self.mix, self.scene.layer.fed_density_ratio)
        except ValueError:
            return None

    @property
    def lift_air(self) -> LiftAir | None:
        """Pore air of the lumped lifts, coupled where the scene requires it; None if it is occluded."""
        air = self.pore_air
        return None if air is None else LiftAir(air, self.scene.mix.pore_air == "coupled")

    @property
    def counts_air(self) -> bool:
        """True if load and resistance contain the pore air, in two dimensions alone."""
        return self.scene.mix.pore_air != "drained" and self.two_dimensions is not None and self.pore_air is not None

    def air_forces(self, speed: float) -> AirForces | None:
        """Return the changes of the strokes by their pore air at a speed of the cart [m/s]; None of drained mix."""
        found, machine = self.two_dimensions, self.problem.machine
        if found is None or not self.counts_air:
            return None
        length, share = machine.roller_length, abs(speed) / machine.cart_speed
        load, resistance = found.air_load.value, found.air_resistance.value
        return AirForces(share * load / length, share * resistance / length, share * found.air_excess_behind)

    @property
    def load(self) -> float:
        """Load of one roller by the best model computed [N]."""
        return self._by_the_best("load")

    @property
    def resistance(self) -> float:
        """Resistance of one roller by the best model computed [N]."""
        return self._by_the_best("resistance")

    def _by_the_best(self, name: str) -> float:
        found = self.two_dimensions
        if found is None:
            return float(getattr(self.row, name))
        return getattr(found, name).value + (getattr(found, f"air_{name}").value if self.counts_air else 0.0)

    def resistance_with(self, scene: Scene) -> float:
        """Estimate the resistance to one cart with another mix [N], by the confined floor and the drag of the sleeves.

        Shear and uneven density are assumed to be in proportion to the confined work.

        Parameters
        ----------
        scene : Scene
            Scene that differs from that of the study by its mix and the density ratio of its feed.
        """
        other, row = replace(self, scene=scene, known=None), self.row
        work = row.confined_work_of(other.problem, other.problem.rate_factor(row.history.mean_bite))
        return self.scene.machine.rollers * self.resistance * work / row.confined_work + (other.sleeve_drag or 0.0)

    @property
    def covered_width(self) -> float:
        """Width of the product that the rollers of one cart press [m]."""
        machine = self.scene.machine
        strips = machine.rollers * (self.scene.motion.stroke - machine.overlap)
        return min(self.scene.product.width, strips)

    @property
    def product_volume(self) -> float:
        """Volume of the product that one cart presses in a stroke [m3]; 0 of a mould at rest."""
        return self.problem.machine.advance * self.covered_width * self.row.product_height

    def mass_per_stroke(self, grains: float) -> float:
        """Convert grains of a section, as a height [m], to the mass of mix in one stroke of a cart [kg]."""
        density = float(bulk_density(self.scene.mix.moisture, 1.0))
        return grains * self.problem.machine.advance * self.covered_width * density

    @cached_property
    def sleeve_drag(self) -> float | None:
        """Drag of all sleeves of a cart [N]; None without the table [sleeve]."""
        table = self.scene.sleeve
        if table is None:
            return None
        sleeve = FeedSleeve(table.width, self.scene.machine.roller_length, table.head, table.wall_friction)
        density = float(bulk_density(self.scene.mix.moisture, self.problem.feed.density_ratio))
        return table.count * sleeve.drag(density, self.mix.friction_angle)

    @property
    def guide_friction(self) -> float:
        """Friction of the guide wheels of a cart under the computed load [N]."""
        rollers = self.scene.machine.rollers
        resistance = rollers * self.resistance + (self.sleeve_drag or 0.0)
        return float(balance(cart(self.scene, self.load), 0.0, resistance, 1.0).guide_friction)

    @property
    def parts(self) -> tuple[ResistancePart, ...]:
        """Parts of the force that moves one cart."""
        rollers, shear, air = self.scene.machine.rollers, None, {}
        if self.two_dimensions is not None:
            shear = rollers * (self.two_dimensions.resistance.value - self.row.resistance)
            if self.counts_air:
                air["pore air (two dimensions)"] = rollers * self.two_dimensions.air_resistance.value
        forces = {
            "confined compression of the throughput": rollers * self.row.resistance,
            "shear, uneven density, bow wave (two dimensions)": shear,
            **air,
            "mix sheared in the feed sleeves": self.sleeve_drag,
            "friction of the guide wheels": self.guide_friction,
        }
        return tuple(ResistancePart(cause, force, self._work_of(force)) for cause, force in forces.items())

    def _work_of(self, force: float | None) -> float | None:
        if force is None or not self.product_volume:
            return None
        return force * self.scene.motion.stroke / self.product_volume

    @cached_property
    def curve(self) -> DensityCurve | None:
        """Processes with the required density over the strokes; None if no gap within the nip angle leads to it."""
        machine = self.problem.machine
        slowest = MAP_MOULD_SHARES[0] / MAP_CART_SHARES[-1]
        most = machine.strokes_on_section / (1.0 if machine.strokes is not None else slowest)
        try:
            return density_curve(self.problem, self.scene.mix.density_ratio, most)
        except BiteError:
            return None

    @property
    def fastest_mould(self) -> float | None:
        """Largest speed of the mould at which the bites that give the density are within the nip angle [m/s]."""
        machine = self.problem.machine
        if self.curve is None:
            return None
        return machine.roller_length / (self.curve.least_strokes * machine.stroke_period)

    @cached_property
    def map(self) -> OperatingMap | None:
        """Load and resistance over both speeds; None for a mould at rest, or where no gap leads to the density."""
        machine = self.problem.machine
        if self.curve is None or machine.strokes is not None:
            return None
        mould_speeds = machine.mould_speed * np.array(MAP_MOULD_SHARES)
        # the dwell at the ends belongs to the time of a stroke
        speeds = self.scene.motion.stroke / machine.stroke_period * np.array(MAP_CART_SHARES)
        return self.curve.map(self.scene.motion.stroke, mould_speeds, speeds)

    @property
    def printed(self) -> tuple[PrintedForce, ...]:
        """Forces of the published machine, if the scene has its roller and product."""
        given = (self.scene.machine.roller_radius, self.scene.product.height)
        known = (published_machine.CART.roller_radius, published_machine.HEIGHT)
        if not np.allclose(given, known, rtol=PRINTED_TOLERANCE):
            return ()
        load, force = published_machine.ROLLER_REACTION, published_machine.MOVING_FORCE
        parts = [(part.cause, part.force) for part in self.parts if part.force is not None]
        computed = sum(each for _, each in parts)
        loads = [("columns, a lower estimate", self.row.load)]
        rest = "density over the height and shear, roller length: not in columns"
        if self.two_dimensions is not None:
            found = self.two_dimensions.load.value
            loads.append(("density over the height and shear (two dimensions)", found - self.row.load))
            if self.counts_air:
                loads.append(("pore air (two dimensions)", self.load - found))
            rest = "roller length, law of the mix, other causes: not computed"
        loads.append((rest, load - self.load))
        unknown = f"{'' if self.two_dimensions else 'shear in two dimensions, '}other causes: not computed"
        causes = (*parts, (unknown, force - computed))
        return (
            PrintedForce("load on one roller", load, self.load, tuple(loads)),
            PrintedForce("force that moves one cart", force, computed, causes),
        )

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences on results that need attention."""
        row, flow, machine = self.row, self.row.flow, self.problem.machine
        fed, grain = row.history.make_up, (self.scene.process and self.scene.process.largest_grain) or 0.0
        count = int(np.sum((fed > 0) & (fed < grain)))
        lack = self.scene.mix.density_ratio - row.product_density_ratio
        short = flow.missing > UNFED_SHARE * flow.product
        sentences = (
            f"in {count} of {row.history.count} strokes the make-up is thinner than the largest grain: the feed is a "
            "standing heap there, not a lift" if count else "",
            f"under-feed: the product has a density ratio of {row.product_density_ratio:.4f} in place of "
            f"{self.scene.mix.density_ratio:g}; {flow.missing / flow.product:.2%} of its mix are missing"
            if short and lack > 0 else "",
            f"over-feed: {flow.extruded / flow.product:.2%} of the product's mix are extruded towards the empty mould"
            + (f", as much as the mould brings back, and {flow.retained / flow.product:.2%} stay in the sleeves"
               if flow.retained > UNFED_SHARE * flow.product else "")
            if flow.extruded > UNFED_SHARE * flow.product else "",
            "no feed: the strokes compact the fill alone" if not flow.fed else "",
            f"the roller touches nothing: the mix stays below the lowest generatrix, {machine.height:g} m"
            if not row.load else "",
            *self._remarks_in_two_dimensions(),
        )  # fmt: skip
        return tuple(sentence for sentence in sentences if sentence)

    def _remarks_in_two_dimensions(self) -> tuple[str, ...]:
        found = self.two_dimensions
        if found is None:
            told = "no lumped lifts: nothing is fed, and columns alone answer"
            return () if self.detail == "columns" else (told,)
        overpressed, beyond = found.of_product("overpressed_height"), found.load.extrapolated_share
        residual = max(sequence.largest_work_residual for sequence in found.sequences)
        stopped = next((sequence.stopped for sequence in found.sequences if sequence.stopped), "")
        tension = float(self.mix.cohesion / np.tan(np.radians(self.mix.friction_angle)))
        return (
            f"the top {overpressed * 1e3:.0f} mm of the product exceed a density ratio of 1: pressed beyond the pores, "
            "outside the law of the mix; water and air would carry the load there" if overpressed else "",
            f"{beyond:.0%} of the load are extrapolated beyond the densest lift" if beyond else "",
            f"the energy balance of a lift closes within {residual:.1%} only" if residual > WORK_LIMIT else "",
            f"a sequence of lifts ends early: {stopped}" if stopped else "",
            "pore air enters one-way; where a bow wave exists, that is a lower bound"
            if self.scene.mix.pore_air == "one-way" and self.counts_air else "",
            "no pore air: it is occluded at layer.fed_density_ratio already, so that a permeability does not apply"
            if self.pore_air is None else "",
            f"an excess pressure of {found.air_excess_behind / 1e3:.0f} kPa behind the roller exceeds the tensile "
            "strength of the mix: lifts may crack" if self.counts_air and found.air_excess_behind > tension else "",
        )  # fmt: skip


@dataclass(frozen=True)
class StrokeForces:
    """Load and resistance of one roller in a forward stroke and in a return stroke.

    With feed before forward strokes alone, the sections under the roller have had their first stroke in forward
    direction, or one stroke later. In a forward stroke each of them gets the force of its last fed stroke, in a return
    stroke that of its last stroke without feed. With feed before every stroke both directions are equal.

    Parameters
    ----------
    row : RollerRow
        Strokes of the columns.
    found : TwoDimensionalRow or None
        Roller row in two dimensions; None by columns alone.
    forward_feed : bool
        True if mix is fed before forward strokes alone.
    """

    row: RollerRow
    found: TwoDimensionalRow | None
    forward_feed: bool

    @property
    def load(self) -> float:
        """Load in a forward stroke [N]."""
        return self._forward("load")

    @property
    def resistance(self) -> float:
        """Resistance in a forward stroke [N]."""
        return self._forward("resistance")

    def _forward(self, name: str) -> float:
        mean = getattr(self.row, name) if self.found is None else getattr(self.found, name).value
        return float(mean * self._share(name, 0))

    @property
    def return_ratios(self) -> tuple[float, float]:
        """Load and resistance of a return stroke over those of a forward stroke [-]."""
        if not self.forward_feed:
            return 1.0, 1.0
        load, resistance = (self._share(name, 1) / self._share(name, 0) for name in ("load", "resistance"))
        return load, resistance

    def of_strokes(self, name: str) -> Array:
        """Return the force of every stroke on a section per roller length [N/m], of lumped lifts on their own mesh.

        Parameters
        ----------
        name : {"load", "resistance"}
            Force.
        """
        if self.found is None:
            return np.asarray(getattr(self.row.history, name))
        forces = self.found.at_strokes(name, self.found.lumpings)
        return forces * self.row.history.make_up if name == "resistance" else forces

    @property
    def errors(self) -> tuple[float, float]:
        """Relative errors of load and resistance [-]: of lumping and mesh, or of the merged layers of columns."""
        if self.found is None:
            return COLUMNS_ERROR, COLUMNS_ERROR
        return self.found.load.error, self.found.resistance.error

    def _share(self, name: str, direction: int) -> float:
        """Return the force in a direction, 0 forward and 1 return, over the mean of both in the product [-]."""
        if not self.forward_feed:
            return 1.0
        strokes = self.of_strokes(name)
        numbers = np.arange(len(strokes))
        last = numbers - (numbers + direction) % 2  # the last stroke of the direction, -1 before the first
        forces = np.where(last >= 0, strokes[np.maximum(last, 0)], 0.0)
        return float(forces @ self.row.lengths) / float(strokes @ self.row.lengths)
