"""Forming process of a scene: strokes under one roller, sleeves, guides, balances.

Columns give the load, its spread along the roller and the confined floor of the resistance. The floor is not for
sizing, and the load is a lower estimate: shear and the density over the height need two dimensions. Lumped lifts
compute these, of two thicknesses ("deep"). Pore air enters them one-way or coupled; drained mix
states its one-way part alone. Every force on a cart has its origin, its spread and the test that would fix it.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from compact.analysis import contact_cases, machine_models
from compact.analysis.pore_air import pore_air_of
from compact.analysis.worker_pool import Executor, SerialExecutor, run_tasks
from compact.engines.column.column_pass import Column
from compact.engines.pore_air import AirForces
from compact.engines.process import loose_mix, roller_row, strokes
from compact.engines.process.forming import Closure, ClosureKind, Feed, FormingMachine
from compact.engines.process.kneading import Kneading
from compact.engines.process.lifts import CASES, KnownLifts, LiftSequence, ProcessDetail, lift_thickness, simulate_lifts
from compact.machine.cart import balance
from compact.material.mix import Mix, bulk_density
from compact.material.pore_air import PoreAir
from compact.scene.loader import Scene, SceneError
from compact.scene.schema import Process

PRESSURE_FACTOR = 2.0  # [-], spread of an assumed pressure on the smoothing plate
MINUTE = 60.0  # [s]
MET = 1e-6  # [-], relative distance from a limit that is rounding


def _pressed(press: Callable[..., LiftSequence], case: tuple[float, int]) -> LiftSequence:
    """Return the lifts of a thickness [m] on a number of elements per contact length."""
    thickness, increments = case
    return press(thickness=thickness, increments=increments)


class ResistancePart(NamedTuple):
    """Part of the force that moves one cart.

    Parameters
    ----------
    cause : str
        Words.
    origin : {"computed", "estimated", "assumed", "measured", "remainder"}
        Origin of the force.
    test : str
        Test that would fix it.
    force, low, high : float or None
        Force and its spread [N]; None where columns do not compute it.
    work : float or None
        Work per volume of the product [J/m3]; None likewise, or of a mould at rest.
    """

    cause: str
    origin: str
    test: str
    force: float | None = None
    low: float | None = None
    high: float | None = None
    work: float | None = None


@dataclass(frozen=True)
class ProcessStudy:
    """Forming process of a scene with the table [process].

    Parameters
    ----------
    scene : Scene
        Scene.
    detail : {"columns", "deep"}
        Columns alone, or with lumped lifts in two dimensions.
    report : callable
        Called with a line of text after each sequence of lifts.
    known : KnownLifts, optional
        Lifts of the same section and mix; without them they are computed.
    executor : Executor, optional
        Open executor of the sequences of lifts; this process by default.

    Raises
    ------
    SceneError
        If the scene has no such table.
    """

    scene: Scene
    detail: ProcessDetail = "columns"
    report: Callable[[str], None] = field(default=lambda _: None, compare=False)
    known: KnownLifts | None = None
    executor: Executor | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        if self.scene.process is None:
            raise SceneError(
                [f"{self.scene.file}: the table [process] is missing; give the mould's speed, the feed and one closure"]
            )

    @property
    def given(self) -> Process:
        """Table [process] of the scene."""
        assert self.scene.process is not None  # required by the constructor
        return self.scene.process

    @cached_property
    def mix(self) -> Mix:
        """Mix of the scene."""
        return contact_cases.scene_mix(self.scene)

    @cached_property
    def problem(self) -> strokes.FormingProblem:
        """Machine, mix and feed."""
        table, machine = self.given, self.scene.machine
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
        fill = Column(self.scene.product.height, table.feed_density_ratio)  # by the first sleeve
        if table.fill_height is not None and table.fill_density_ratio is not None:
            fill = Column(table.fill_height, table.fill_density_ratio)
        feed = Feed(table.feed_density_ratio, table.feed, table.feed_count or 0, table.feeds)
        kneading = None if table.kneading is None else Kneading(*table.kneading)
        material = contact_cases.compaction_material(self.scene, self.mix)
        return strokes.FormingProblem(forming, material, fill, feed, table.layers, kneading)

    @property
    def closure(self) -> Closure:
        """Condition that determines the feed."""
        table = self.given
        kinds: tuple[ClosureKind, ...] = ("gap", "product_density_ratio", "extrusion_pressure")
        kind = next((kind for kind in kinds if getattr(table, kind) is not None), kinds[-1])
        value = self.extrusion_pressures[0] if kind == kinds[-1] else getattr(table, kind)
        return Closure(kind, value, table.offered_thickness)

    @cached_property
    def history(self) -> strokes.SectionHistory:
        """Strokes on one section at the mean speed."""
        return strokes.solve_closure(self.problem, self.closure)

    @cached_property
    def lifts(self) -> KnownLifts | None:
        """Lumped lifts in two dimensions; None by columns alone or without feed."""
        history, machine = self.history, self.problem.machine
        if self.known is not None or not CASES[self.detail] or not history.make_up.any():
            return self.known
        density_ratio, pore_air = history.of_product("density_ratio"), self.pore_air
        air = None if pore_air is None else (pore_air, self.scene.mix.pore_air == "coupled")
        press = partial(
            simulate_lifts, self.problem, self.mix.steel_friction, history.rate_factor, density_ratio, air=air
        )
        cases = [(lift_thickness(machine, history.make_up, share), count) for share, count in CASES[self.detail]]
        found = dict[int, LiftSequence]()
        for number, job in run_tasks(partial(_pressed, press), cases, self.executor or SerialExecutor()):
            found[number] = job.result()
            thickness, count = cases[number]
            self.report(f"lifts of {thickness * 1e3:.3g} mm, {count} elements: {len(found[number].lifts)} pressed")
        sequences = tuple(found[number] for number in sorted(found))
        return KnownLifts(sequences, history.rate_factor, machine.cart_speed)

    @cached_property
    def row(self) -> roller_row.RollerRow:
        """Strokes under one roller at the mean speed."""
        return roller_row.RollerRow(self.history, self.scene.mix.density_ratio, self.lifts)

    def row_at(self, speed: float) -> roller_row.RollerRow:
        """Compute the strokes under one roller at another speed of the cart [m/s], in strokes of the same duration.

        The gap of the feed, or its thickness or pressure, is that of the closure at the mean speed. A place along the
        travel is passed at nearly the same speed in every stroke, so that all strokes on a section have one rate.
        """
        if speed == self.problem.machine.cart_speed:
            return self.row
        problem, factor, history = self.problem.at_speed(speed), self.rate_factor_at(speed), self.history
        if self.closure.kind == "extrusion_pressure":
            history = problem.at_pressure(self.closure.value, history.offered, factor)
        else:
            history = problem.with_amount(history.amount, factor)
        return replace(self.row, history=history.within_nip())

    def rate_factor_at(self, speed: float) -> float:
        """Return the factor of the yield pressure [-] of strokes at a speed of the cart [m/s]."""
        return self.problem.at_speed(abs(speed)).rate_factor(self.history.mean_bite)

    @property
    def pore_air(self) -> PoreAir | None:
        """Pore air with its permeability at the density of [layer], as in `compact run`; None if it is occluded."""
        try:
            return pore_air_of(self.mix, self.scene.layer.fed_density_ratio)
        except ValueError:
            return None

    @property
    def counts_air(self) -> bool:
        """True if load and resistance contain the pore air, in two dimensions alone."""
        return self.scene.mix.pore_air != "drained" and self.lifts is not None and self.pore_air is not None

    def air_forces(self, speed: float) -> AirForces | None:
        """Return the changes of the strokes by their pore air at a speed of the cart [m/s]; None of drained mix."""
        if not self.counts_air:
            return None
        row, machine = self.row, self.problem.machine
        share, length = abs(speed) / machine.cart_speed, machine.roller_length
        load, resistance = (share * row.estimate(f"air_{name}").value / length for name in ("load", "resistance"))
        return AirForces(load, resistance, share * row.numbers_by_lifts["air_excess_behind"])

    @property
    def load(self) -> float:
        """Load of one roller by the best model computed [N]."""
        return self._by_the_best("load")

    @property
    def resistance(self) -> float:
        """Resistance of one roller by the best model computed [N]."""
        return self._by_the_best("resistance")

    def _by_the_best(self, name: str) -> float:
        return self.row.estimate(name).value + (self.row.estimate(f"air_{name}").value if self.counts_air else 0.0)

    def resistance_with(self, scene: Scene) -> float:
        """Estimate the resistance to one cart with another mix [N], by the confined floor and the drag of the sleeves.

        Shear and uneven density are assumed to be in proportion to the confined work.

        Parameters
        ----------
        scene : Scene
            Scene that differs from that of the study by its mix and the density ratio of its feed.
        """
        other, row = replace(self, scene=scene, known=None), self.row
        work = row.confined_work_of(other.problem, other.problem.rate_factor(self.history.mean_bite))
        own = row.confined_work_of(self.problem, self.history.rate_factor)
        return self.scene.machine.rollers * self.resistance * work / own + other.standing_drag

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

    @property
    def mix_balance(self) -> dict[str, float]:
        """Mix in one stroke of a cart [kg], by the names of `MixFlow`; heights of grains of a mould at rest [m]."""
        machine, flow = self.problem.machine, self.row.flow._asdict()
        if machine.strokes is not None:
            return flow
        density = float(bulk_density(self.scene.mix.moisture, 1.0))
        return {name: grains * machine.advance * self.covered_width * density for name, grains in flow.items()}

    @property
    def standing_drag(self) -> float:
        """Drag of sleeves and smoothing plate of a cart [N], at any speed."""
        return self.sleeve_drag + (self._plate.force or 0.0)

    @property
    def sleeve_drag(self) -> float:
        """Drag of the feed sleeves of a cart [N]."""
        return self._sleeves.force or 0.0

    @property
    def moving_force(self) -> float:
        """Force that moves one cart by the best model computed [N], the sum of its parts."""
        return sum(each.force or 0.0 for each in self._causes)

    @property
    def _loose_density(self) -> float:
        """Bulk density of the feed [kg/m3]."""
        return float(bulk_density(self.scene.mix.moisture, self.problem.feed.density_ratio))

    @cached_property
    def _sleeves(self) -> ResistancePart:
        """Mix sheared in the sleeves: full stress at rest; mix that flows to a rougher opening, and a smoother wall."""
        table, length, wall = self.scene.sleeve, self.scene.machine.roller_length, self.mix.parameter("steel_friction")
        test = "sleeve.measured_drag: pull of the cart with full sleeves over a hard plate"
        part = ResistancePart("mix sheared in the feed sleeves", "assumed", test)
        if table is None:
            return part
        if table.measured_drag is not None:
            return ResistancePart(part.cause, "measured", test, *[table.measured_drag] * 3)

        def drag(friction: float, flowing: bool) -> float:
            given = table.width, length, table.head, friction, self._loose_density, self.mix.friction_angle
            return table.count * loose_mix.sleeve_drag(*given, flowing)

        spread, friction = (wall.high - wall.low) / 2, table.wall_friction
        high = drag(max(friction - spread, 0.0), False)
        return part._replace(force=drag(friction, False), low=drag(friction + spread, True), high=high)

    @property
    def _plate(self) -> ResistancePart:
        """Friction of the smoothing plate, which slides with the cart over the strips of its rollers."""
        table, friction = self.given, self.mix.parameter("steel_friction")
        part = ResistancePart("friction of the smoothing plate", "assumed", "the same pull with the plate raised")
        if table.plate_length is None or table.plate_pressure is None:
            return part
        load = table.plate_pressure * table.plate_length * self.covered_width
        force, low, high = (load * each for each in (friction.value, friction.low, friction.high))
        return part._replace(force=force, low=low / PRESSURE_FACTOR, high=high * PRESSURE_FACTOR)

    @cached_property
    def extrusion_pressures(self) -> tuple[float, float, float]:
        """Pressure at which mix evades along the axis [Pa], and its bounds: the given one, or by the wedge."""
        if given := self.given.extrusion_pressure:
            return given, given, given
        angle, cohesion = (self.mix.parameter(name) for name in ("friction_angle", "cohesion_loose"))
        height, density = self.scene.product.height, self._loose_density
        low, value, high = (
            loose_mix.extrusion_pressure(height, density, getattr(angle, end), getattr(cohesion, end))
            for end in ("low", "value", "high")
        )
        return value, low, high

    @property
    def _extrusion(self) -> ResistancePart:
        """Work of the mix that evades, at most all of the fill, over the stroke."""
        flow, (pressure, _, high), k = self.row.flow, self.extrusion_pressures, self.problem.feed.density_ratio
        swept = self.problem.machine.advance * self.covered_width / k / self.scene.motion.stroke
        force, most = pressure * flow.extruded * swept, high * flow.fill * swept
        test = "length of the extruded tongue"
        return ResistancePart("mix extruded towards the empty mould", "estimated", test, force, 0.0, most)

    @property
    def guide_friction(self) -> float:
        """Friction of the guide wheels of a cart under the computed load [N]."""
        resistance = self.scene.machine.rollers * self.resistance + self.standing_drag
        return float(balance(machine_models.cart(self.scene, self.load), 0.0, resistance, 1.0).guide_friction)

    @property
    def _forming(self) -> Iterator[ResistancePart]:
        """Parts of the mix under the rollers; their spread is that of the Heckel slope, and of lumping and mesh."""
        row, rollers, slope = self.row, self.scene.machine.rollers, self.mix.parameter("heckel_slope")
        weaker, stronger = slope.value / slope.high, slope.value / slope.low

        def part(cause: str, test: str, force: float, error: float) -> ResistancePart:
            force *= rollers
            ends = force * weaker * max(1 - error, 0.0), force * stronger * (1 + error)
            return ResistancePart(cause, "computed", test, force, *ends)

        shear, cores = "shear, uneven density, bow wave (two dimensions)", "density of a cored product at three heights"
        tests, pressed = "confined compression of the mix, or gyratory compaction", row.estimate("resistance")
        if self.problem.kneading is not None and row.lifts is not None:
            yield part("forming, kneaded (two dimensions)", tests, pressed.value, pressed.error)
        else:
            yield part("confined compression of the throughput", tests, row.resistance, 0.0)
            if row.lifts is None:
                yield ResistancePart(shear, "computed", cores)
            else:
                rest = pressed.value - row.resistance
                yield part(shear, cores, rest, pressed.error * pressed.value / rest)
        if self.counts_air:
            air = row.estimate("air_resistance")
            yield part("pore air (two dimensions)", "air permeability of the fed mix", air.value, air.error)

    @property
    def _causes(self) -> list[ResistancePart]:
        """Parts of the force that moves one cart."""
        guides = self.guide_friction
        rolling = ResistancePart("friction of the guide wheels", "computed", "pull with raised rollers", *[guides] * 3)
        return [*self._forming, self._sleeves, self._plate, self._extrusion, rolling]

    @property
    def parts(self) -> tuple[ResistancePart, ...]:
        """Parts of the force that moves one cart, and what they leave of a measured or printed one."""
        found = self._causes
        if measured := self.given.measured_force:
            sums = [sum(getattr(each, end) or 0.0 for each in found) for end in ("force", "high", "low")]
            left = (measured - each for each in sums)
            test = "force over the first strokes, mould at rest, sleeves empty and full"
            found.append(ResistancePart("not explained", "remainder", test, *left))
        if self.product_volume:
            scale = self.scene.motion.stroke / self.product_volume
            found = [each if each.force is None else each._replace(work=each.force * scale) for each in found]
        return tuple(found)

    @property
    def beyond_rows(self) -> list[tuple[str, str, float, tuple[float, ...]]]:
        """Quantity, unit, value and range of what is beyond the rows of a plant to which the scene is calibrated."""
        table, machine = self.given, self.problem.machine
        known = (
            ("advance of the mould a stroke", " m", machine.advance, table.measured_advances or ()),
            ("number of strokes a minute", "", MINUTE / machine.stroke_period, table.measured_strokes or ()),
        )
        return [each for each in known if each[3] and not each[3][0] * (1 - MET) <= each[2] <= each[3][1] * (1 + MET)]

    @property
    def evasion_ends(self) -> list[tuple[float, float]]:
        """Bounds of a pressure of extrusion by the wedge [Pa] with their density ratios [-]; empty of a given one."""
        pressure, *bounds = self.extrusion_pressures
        if self.closure.kind != "extrusion_pressure" or pressure in bounds:
            return []
        few = replace(self.problem, layers=strokes.SEARCH_LAYERS)
        ends = (strokes.solve_closure(few, replace(self.closure, value=bound)) for bound in bounds)
        return [(bound, each.of_product("density_ratio")) for bound, each in zip(bounds, ends, strict=True)]

    @property
    def thin_strokes(self) -> int:
        """Number of strokes whose make-up is thinner than the largest grain."""
        fed, grain = self.history.make_up, self.given.largest_grain or 0.0
        return int(np.sum((fed > 0) & (fed < grain)))

    @property
    def has_kneaded_prior(self) -> bool:
        """True if the Heckel slope is that of the prior, of kneaded mix."""
        return self.problem.kneading is None and self.mix.parameter("heckel_slope").flag != "given"
