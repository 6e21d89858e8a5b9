"""Forming process of a scene: strokes under one roller, sleeves, guides, balances.

Columns give the load, its spread along the roller and the confined floor of the resistance. The floor is not for
sizing, and the load is a lower estimate: shear and the density over the height need two dimensions. Lumped lifts
compute these, of two thicknesses on one mesh ("quick"), or of three thicknesses and on three meshes ("deep"). Pore air
enters them one-way or coupled; drained mix states its one-way part alone.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from compact.analysis.contact_cases import compaction_material, scene_mix
from compact.analysis.machine_models import cart
from compact.analysis.pore_air import pore_air_of
from compact.engines.column.column_pass import Column
from compact.engines.pore_air import AirForces
from compact.engines.process.forming import Closure, ClosureKind, Feed, FormingMachine
from compact.engines.process.lifts import CASES, KnownLifts, ProcessDetail, lift_thickness, simulate_lifts
from compact.engines.process.roller_row import RollerRow, sleeve_drag
from compact.engines.process.strokes import FormingProblem, SectionHistory, solve_closure
from compact.machine.cart import balance
from compact.material.mix import Mix, bulk_density
from compact.material.pore_air import PoreAir
from compact.scene.loader import Scene, SceneError

WORK_LIMIT = 2e-2  # [-], residual of the energy balance of a pass
UNFED_SHARE = 1e-6  # [-], of the product; less missing or surplus mix is rounding


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
        fill = Column(self.scene.product.height, table.feed_density_ratio)  # by the first sleeve
        if table.fill_height is not None and table.fill_density_ratio is not None:
            fill = Column(table.fill_height, table.fill_density_ratio)
        feed = Feed(table.feed_density_ratio, table.feed, table.feed_count or 0, table.feeds)
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
    def history(self) -> SectionHistory:
        """Strokes on one section at the mean speed."""
        return solve_closure(self.problem, self.closure)

    @cached_property
    def lifts(self) -> KnownLifts | None:
        """Lumped lifts in two dimensions; None by columns alone or without feed."""
        history, machine = self.history, self.problem.machine
        if self.known is not None or not CASES[self.detail] or not history.make_up.any():
            return self.known
        density_ratio, pore_air = history.of_product("density_ratio"), self.pore_air
        sequences = tuple(
            simulate_lifts(
                self.problem, self.mix.steel_friction, history.rate_factor, density_ratio,
                thickness=lift_thickness(machine, history.make_up, share), increments=increments,
                air=None if pore_air is None else (pore_air, self.scene.mix.pore_air == "coupled"), report=self.report,
            )
            for share, increments in CASES[self.detail]
        )  # fmt: skip
        return KnownLifts(sequences, history.rate_factor, machine.cart_speed)

    @cached_property
    def row(self) -> RollerRow:
        """Strokes under one roller at the mean speed."""
        return RollerRow(self.history, self.scene.mix.density_ratio, self.lifts)

    def row_at(self, speed: float) -> RollerRow:
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
        share, behind = abs(speed) / machine.cart_speed, row.numbers_by_lifts["air_excess_behind"]
        load, resistance = (
            row.estimate(f"air_{name}").value / machine.roller_length for name in ("load", "resistance")
        )
        return AirForces(share * load, share * resistance, share * behind)

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
        return self.scene.machine.rollers * self.resistance * work / own + (other.sleeve_drag or 0.0)

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

    @cached_property
    def sleeve_drag(self) -> float | None:
        """Drag of all sleeves of a cart [N]; None without the table [sleeve]."""
        table, length = self.scene.sleeve, self.scene.machine.roller_length
        if table is None:
            return None
        density = float(bulk_density(self.scene.mix.moisture, self.problem.feed.density_ratio))
        given = table.width, length, table.head, table.wall_friction
        return table.count * sleeve_drag(*given, density, self.mix.friction_angle)

    @property
    def guide_friction(self) -> float:
        """Friction of the guide wheels of a cart under the computed load [N]."""
        resistance = self.scene.machine.rollers * self.resistance + (self.sleeve_drag or 0.0)
        return float(balance(cart(self.scene, self.load), 0.0, resistance, 1.0).guide_friction)

    @property
    def parts(self) -> tuple[ResistancePart, ...]:
        """Parts of the force that moves one cart."""
        row, rollers, air = self.row, self.scene.machine.rollers, {}
        if self.counts_air:
            air["pore air (two dimensions)"] = rollers * row.estimate("air_resistance").value
        forces = {
            "confined compression of the throughput": rollers * row.resistance,
            "shear, uneven density, bow wave (two dimensions)":
                None if row.lifts is None else rollers * (row.estimate("resistance").value - row.resistance),
            **air,
            "mix sheared in the feed sleeves": self.sleeve_drag,
            "friction of the guide wheels": self.guide_friction,
        }  # fmt: skip
        stroke, volume = self.scene.motion.stroke, self.product_volume
        return tuple(
            ResistancePart(cause, force, None if force is None or not volume else force * stroke / volume)
            for cause, force in forces.items()
        )

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences on results that need attention."""
        row, flow, fed = self.row, self.row.flow, self.history.make_up
        grain = (self.scene.process and self.scene.process.largest_grain) or 0.0
        count = int(np.sum((fed > 0) & (fed < grain)))
        lack = self.scene.mix.density_ratio - row.product_density_ratio
        sentences: list[Any] = [
            count and f"in {count} of {self.history.count} strokes the make-up is thinner than the largest grain: the "
            "feed is a standing heap there, not a lift",
            flow.missing > UNFED_SHARE * flow.product and lack > 0
            and f"under-feed: the product has a density ratio of {row.product_density_ratio:.4f} in place of "
            f"{self.scene.mix.density_ratio:g}; {flow.missing / flow.product:.2%} of its mix are missing",
            flow.extruded > UNFED_SHARE * flow.product
            and f"over-feed: {flow.extruded / flow.product:.2%} of the product's mix are extruded towards the empty "
            f"mould, and {flow.retained / flow.product:.2%} stay in the sleeves",
        ]  # fmt: skip
        if self.lifts is not None:
            found, tension = row.numbers_by_lifts, self.mix.cohesion / np.tan(np.radians(self.mix.friction_angle))
            beyond, residual = row.estimate("load").extrapolated_share, found["largest_work_residual"]
            stopped = next((each.stopped for each in self.lifts.sequences if each.stopped), "")
            sentences += [
                found["overpressed_height"]
                and f"the top {found['overpressed_height'] * 1e3:.0f} mm of the product exceed a density ratio of 1: "
                "pressed beyond the pores, outside the law of the mix; water and air would carry the load there",
                beyond and f"{beyond:.0%} of the load are extrapolated beyond the densest lift",
                residual > WORK_LIMIT and f"the energy balance of a lift closes within {residual:.1%} only",
                stopped and f"a sequence of lifts ends early: {stopped}",
                self.scene.mix.pore_air == "one-way" and self.counts_air
                and "pore air enters one-way; where a bow wave exists, that is a lower bound",
                self.pore_air is None
                and "no pore air: it is occluded at layer.fed_density_ratio already, so that a permeability does not "
                "apply",
                self.counts_air and found["air_excess_behind"] > tension
                and f"an excess pressure of {found['air_excess_behind'] / 1e3:.0f} kPa behind the roller exceeds the "
                "tensile strength of the mix: lifts may crack",
            ]  # fmt: skip
        return tuple(str(sentence) for sentence in sentences if sentence)
