"""Forming process along one roller: forces by columns and by lumped lifts, balances, confined floor, fields.

The sections under the roller have had 1, 2, ... N strokes, so that the forces of the strokes on one section, in order,
are those along the roller at one instant:

    P = sum_n P_n dz_n,    F = sum_n F_n dz_n,    z_P = sum_n P_n z_n dz_n/P,    M = P (z_P - L/2)

with the length dz_n = v_form T on which stroke n meets its sections, of the last stroke the rest of L. M is the moment
by which the load tilts the roller in its guides.

The confined floor of the resistance is the work of confined compression of the throughput, in closed form:

    F = v_form T h_out w,    w = k_out sum_i c_i int_k_i^k_out s_v(k)/k^2 dk,    s_v = A (f pc(k) + pt) - pt

per roller, with the advance v_form T of the mould per stroke, the height h_out of the product, and the work w per
volume of the product. c_i is the share of grains that enter at the density ratio k_i, as fill or as feed. A rigid-
plastic column follows s_v; the elastic strain of a real one changes w by about 1 %.

The floor neither depends on the roller length nor on the number of strokes nor on the law of the feed: a stroke returns
the elastic work of the one before, and the plastic work of confined mix depends on its densities alone. It is the least
resistance that any model of the process can have, since shear in two dimensions adds to it. It is not for sizing.

Lumped lifts give load and resistance in two dimensions as sums over the same strokes:

    P_row = sum_n P(k_n) dz_n,    F_row = v_form T sum_n (F/t)(k_n) t_n

The strokes n have the mean density k_n, the length dz_n along the roller and the make-up t_n of the columns: the mean
density follows from the balance of mix, whatever the model. P and F/t come from lumped lifts as functions of the mean
density, the first at that behind a stroke, the second at the mean of both sides. Between lifts their logarithms are
interpolated; beyond the last lift they are extrapolated, and the share of the result that is extrapolated is stated.

P and F/t are extrapolated linearly in the thickness of the lifts to t_n at every density. Errors, added as independent
ones: the difference to a power law of the thickness, and that of the mesh by the engine.

The excess pressure of the pore air is in proportion to the mix that a pass displaces, as long as its flow is linear:

    P_air(t_n) = P_air(t) t_n/t,    F_air/t_n = (F_air/t) t_n/t

Both are taken from the thinnest lifts; the error is the difference to the thickest.

With feed before forward strokes alone, the sections under the roller have had their first stroke in forward direction,
or one stroke later. In a forward stroke each of them gets the force of its last fed stroke, in a return stroke that of
its last stroke without feed. With feed before every stroke both directions are equal.

The row is also the contact of the engine "process". Over a stroke its resistance depends on the speed alone:

    rate         the yield pressure follows the speed of the cart where it passes a section, by the rate factor
    pore air     its forces are in proportion to the speed, where `mix.pore_air` counts them
    acceleration does not enter: the mix has no memory in time
    position     does not enter: every section along the travel has had the same strokes. The overlap of two rollers,
                 3 % of the stroke in the published machine, is met by both; the mean force is also the largest one
    duration     at a given speed of the mould, F grows with the time of a stroke, in which the mould brings more mix:
                 each duration of a pass has a map of its own (`ResistanceStage.over`)

Fields of a process are rectangles in z, along the roller, and y, the height. In two dimensions the rows of a section
are those of the lumped lifts at its mean density. Frame n shows the mould after the n-th stroke since its start: the
first section has had n strokes and lies farthest from the empty mould, and loose fill follows it.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from compact.engines.column.column_pass import Column, Columns
from compact.engines.process.lifts import KnownLifts, LiftSequence
from compact.engines.process.strokes import (
    FormingProblem,
    SectionHistory,
    SectionState,
    confined_work,
    mean_over_height,
)
from compact.numerics import Array
from compact.rolling_contact import Contact

if TYPE_CHECKING:
    import meshio

COLUMNS_ERROR = 1e-6  # [-], of the forces; difference of 3, 20 and 80 merged layers
MIDDLE = 0.375, 0.625  # [-], shares of the height over which the density of the middle is averaged
FRAMES_MAX = 60  # [-], frames of a series; later strokes are shown at equal intervals
FILL_SHARE = 0.15  # [-], length of the fill shown in front of the roller over that of the roller


class MixFlow(NamedTuple):
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


class Estimate(NamedTuple):
    """Number with its error.

    Parameters
    ----------
    value : float
        Value in its unit.
    lumping_error, mesh_error : float
        Relative errors by the thickness of the lifts and by the mesh, or by the merged layers of columns [-].
    extrapolated_share : float
        Share of the value from strokes denser than the densest lift [-].
    """

    value: float
    lumping_error: float = 0.0
    mesh_error: float = 0.0
    extrapolated_share: float = 0.0

    @property
    def error(self) -> float:
        """Relative error of both causes [-]."""
        return float(np.hypot(self.lumping_error, self.mesh_error))


@dataclass(frozen=True, eq=False)
class RollerRow:
    """Forming process of one roller.

    Parameters
    ----------
    history : SectionHistory
        Strokes on one section.
    required_density_ratio : float
        Density ratio that the product should have [-].
    lifts : KnownLifts, optional
        Lumped lifts; None by columns alone.
    """

    history: SectionHistory
    required_density_ratio: float
    lifts: KnownLifts | None = None

    @property
    def problem(self) -> FormingProblem:
        """Machine, mix and feed."""
        return self.history.problem

    @cached_property
    def edges(self) -> Array:
        """Ends along the roller between which each stroke meets its sections [m]; at rest all meet the last one."""
        machine = self.problem.machine
        if machine.strokes is None:
            return machine.edges
        return np.append(np.zeros(machine.stroke_count), machine.roller_length)

    @property
    def lengths(self) -> Array:
        """Length of the roller on which each stroke meets its sections [m]."""
        return np.diff(self.edges)

    @property
    def load(self) -> float:
        """Load of the roller by columns [N]."""
        return float(self.history.load @ self.lengths)

    @property
    def resistance(self) -> float:
        """Resistance of the roller by columns [N]."""
        return float(self.history.resistance @ self.lengths)

    @property
    def product_height(self) -> float:
        """Height of the product after its elastic recovery [m]."""
        return self.history.of_product("height")

    @property
    def product_density_ratio(self) -> float:
        """Mean density ratio of the product [-]."""
        return self.history.of_product("density_ratio")

    def centre_of(self, line_load: Array) -> float:
        """Return the centre of the loads of the strokes per unit roller length [N/m], from the empty mould [m]."""
        middle = (self.edges[:-1] + self.edges[1:]) / 2
        load = line_load * self.lengths
        return float(load @ middle / load.sum()) if load.sum() else self.problem.machine.roller_length / 2

    @cached_property
    def flow(self) -> MixFlow:
        """Grains of product, fill and feed per stroke."""
        history, mean, k = self.history, self.problem.machine.mean_of_product, self.problem.feed.density_ratio
        fill, product = history.states[0].grain_height, history.of_product("grain_height")
        strokes = history.make_up, history.offered - history.make_up
        fed, surplus = (k * mean(float(each[:-1].sum()), float(each.sum())) for each in strokes)
        extruded, lack = min(surplus, fill), self.required_density_ratio / self.product_density_ratio - 1
        return MixFlow(product, fill, fed, extruded, surplus - extruded, max(lack, 0.0) * product)

    def confined_work_of(self, problem: FormingProblem, rate_factor: float) -> float:
        """Return the work of confined compression of another mix [J/m3] with the same grains of fill and feed."""
        flow = self.flow
        total = flow.fill + flow.fed
        entries = (flow.fill / total, problem.fill.density_ratio), (flow.fed / total, problem.feed.density_ratio)
        return confined_work(problem.material, entries, self.product_density_ratio, rate_factor)

    @property
    def numbers(self) -> dict[str, float]:
        """Results by columns, by the names of `quantities.PROCESS`."""
        history, machine, load = self.history, self.problem.machine, self.load
        centre, mean = self.centre_of(history.load), load / machine.roller_length
        work = self.confined_work_of(self.problem, history.rate_factor)
        return {
            "load": load,
            "resistance": self.resistance,
            "confined_floor": machine.advance * self.product_height * work,
            "load_centre": centre,
            "skew_moment": load * (centre - machine.roller_length / 2),
            "load_unevenness": float(history.load[self.lengths > 0].max()) / mean if mean else 1.0,
            "peak_pressure": float(history.peak_pressure.max()),
            "strokes": machine.strokes_on_section,
            "largest_bite": float(history.bite.max()),
            "bite_limit": machine.max_bite,
            "product_height": self.product_height,
            "product_density_ratio": self.product_density_ratio,
            "confined_work": work,
            "rate_factor": history.rate_factor,
            "mass_residual": history.mass_residual,
            "work_residual": history.work_residual,
        }

    # by lumped lifts

    @property
    def thinnest(self) -> LiftSequence:
        """Sequence of the thinnest lifts."""
        assert self.lifts is not None
        return self.lifts.sequences[0]

    @property
    def rate_scale(self) -> float:
        """Rate factor of the strokes over that of the lifts [-], to which their forces are in proportion."""
        assert self.lifts is not None
        return self.history.rate_factor / self.lifts.rate_factor

    @property
    def air_scale(self) -> float:
        """Speed of the strokes over that of the lifts [-], to which the forces of their pore air are in proportion."""
        assert self.lifts is not None
        return self.problem.machine.cart_speed / self.lifts.cart_speed

    @property
    def numbers_by_lifts(self) -> dict[str, float]:
        """Results of the thinnest lifts, by the names of `quantities.PROCESS_LIFTS`.

        Fields are those at the density of the product, or behind the last lift if that is less.
        """
        assert self.lifts is not None
        machine, load, ratio = self.problem.machine, self.estimate("load").value, self.thinnest.values("density_ratio")
        centre, swept = self.centre_of(self.at_strokes("load")), machine.advance * self.product_height
        product = ("bottom_density_ratio", "top_density_ratio", "saturated_height", "surface", "gyrations")
        at = self.product_density_ratio
        heights, ratios, _ = self.thinnest.profile_at(at)
        return {
            "air_excess_behind": float(self.thinnest.values("air_excess_behind").max()) * self.air_scale,
            "load_centre": centre,
            "skew_moment": load * (centre - machine.roller_length / 2),
            "specific_work": self.estimate("resistance").value / swept if swept else float("nan"),
            "middle_density_ratio": mean_over_height(heights, ratios, *MIDDLE),
            **{name: float(np.interp(at, ratio, self.thinnest.values(name))) for name in product},
            "largest_work_residual": max(each.largest_work_residual for each in self.lifts.sequences),
        }

    def at_strokes(self, name: str, *, power: bool = False) -> Array:
        """Return P or F/t of every stroke [N/m, N/m2], extrapolated in the thickness of the lifts to its make-up.

        Parameters
        ----------
        name : {"load", "resistance"}
            Force.
        power : bool
            True for a power law of the thickness, False for a line.
        """
        assert self.lifts is not None
        sequences, density, made_up = self.lifts.sequences, self._densities(name), self.history.make_up
        thin = self.rate_scale * sequences[0].at(name, density)
        if len(sequences) == 1:
            return thin
        thickness, ratio = sequences[0].thickness, sequences[-1].thickness / sequences[0].thickness
        common = np.minimum(density, min(each.values("density_ratio").max() for each in sequences))
        thicker = sequences[-1].at(name, common) / sequences[0].at(name, common)  # beyond both, as at their end
        if power:
            share = np.where(made_up > 0, made_up, thickness) / thickness
            return np.asarray(thin * share ** (np.log(thicker) / np.log(ratio)))
        return np.asarray(thin * (1 + (thicker - 1) * (made_up / thickness - 1) / (ratio - 1)))

    def _densities(self, name: str) -> Array:
        """Mean density ratio of every stroke to which a force belongs [-]: behind it, or the mean of both sides."""
        states = np.array([state.density_ratio for state in self.history.states])
        return states[1:] if name.endswith("load") else (states[:-1] + states[1:]) / 2

    def _weights(self, name: str) -> Array:
        """Weights of the strokes in a sum: their lengths [m], or the mix that they press over an advance [m2]."""
        if name.endswith("load"):
            return self.lengths
        machine = self.problem.machine
        shares = machine.stroke_shares if machine.strokes is None else 1.0
        return np.asarray(machine.advance * self.history.make_up * shares)

    def estimate(self, name: str) -> Estimate:
        """Estimate a force on the roller [N] by lumped lifts, or by columns without any.

        Parameters
        ----------
        name : {"load", "resistance", "air_load", "air_resistance"}
            Force, without pore air, or its part by the excess pressure of the pore air; 0 of a resistance over a mould
            at rest, whose work per stroke is not that of the row.
        """
        if self.lifts is None:
            return Estimate(float(getattr(self.history, name) @ self.lengths), 0.0, COLUMNS_ERROR)
        sequences, weights = self.lifts.sequences, self._weights(name)
        if name.startswith("air"):
            weights, density = self.history.make_up * weights * self.air_scale, self._densities(name)
            value, thickest = (float(each.at(name, density) @ weights) for each in (sequences[0], sequences[-1]))
            return Estimate(value, abs(thickest / value - 1)) if value else Estimate(0.0)
        forces = self.at_strokes(name)
        value = float(forces @ weights)
        if value == 0:
            return Estimate(0.0)
        lumping = abs(float(self.at_strokes(name, power=True) @ weights) / value - 1) if len(sequences) > 1 else 0.0
        mesh = float(np.average(self.thinnest.values(f"{name}_error"), weights=self.thinnest.values(name)))
        beyond = self.history.density_ratio > min(each.values("density_ratio").max() for each in sequences)
        return Estimate(value, lumping, mesh, float(forces[beyond] @ weights[beyond]) / value)

    # strokes in both directions, as a contact of the engine

    def of_strokes(self, name: str) -> Array:
        """Return the force of every stroke on a section per roller length [N/m], of lumped lifts on their own mesh.

        Parameters
        ----------
        name : {"load", "resistance"}
            Force.
        """
        if self.lifts is None:
            return np.asarray(getattr(self.history, name))
        return self.at_strokes(name) * (self.history.make_up if name == "resistance" else 1.0)

    def share(self, name: str, direction: int) -> float:
        """Return a force in a direction, 0 forward and 1 return, over the mean of both in the product [-]."""
        if self.problem.feed.strokes != "forward":
            return 1.0
        strokes = self.of_strokes(name)
        numbers = np.arange(len(strokes))
        last = numbers - (numbers + direction) % 2  # the last stroke of the direction, -1 before the first
        forces = np.where(last >= 0, strokes[np.maximum(last, 0)], 0.0)
        return float(forces @ self.lengths) / float(strokes @ self.lengths)

    @property
    def return_ratios(self) -> tuple[float, float]:
        """Load and resistance of a return stroke over those of a forward stroke [-]."""
        load, resistance = (self.share(name, 1) / self.share(name, 0) for name in ("load", "resistance"))
        return load, resistance

    def contact(self, speed: float) -> Contact:
        """Return all strokes under the roller in a forward stroke at a speed of the cart [m/s], as one contact.

        Forces are means over the roller length, the indentation is the mean bite, the edges are weighted by the load
        of the strokes, the exit is the product.
        """
        history, length = self.history, self.problem.machine.roller_length
        weights, peak = history.load * self.lengths, float(history.peak_pressure.max())
        weights = weights / weights.sum() if weights.any() else np.full(len(weights), 1 / len(weights))
        columns, residual = history.states[-1].columns, history.work_residual
        if self.lifts is not None:
            columns = tuple(Column(*each) for each in self.thinnest.profile_at(self.product_density_ratio).T.tolist())
            ratio, peaks = self.thinnest.values("density_ratio"), self.thinnest.values("peak_pressure")
            peak = self.rate_scale * float(np.interp(self.product_density_ratio, ratio, peaks))
            residual = max(residual, *(sequence.largest_work_residual for sequence in self.lifts.sequences))
        estimates = {name: self.estimate(name) for name in ("load", "resistance")}
        load, resistance = (each.value * self.share(name, 0) / length for name, each in estimates.items())
        return Contact(
            load=load, resistance=float(np.copysign(resistance, speed)),
            leading=float(weights @ history.leading), trailing=float(weights @ history.trailing),
            error=(estimates["load"].error, estimates["resistance"].error), work_residual=residual, peak_pressure=peak,
            indentation=float(weights @ np.maximum(history.bite, 0.0)), exit_height=self.product_height,
            exit_density_ratio=self.product_density_ratio, mass_residual=history.mass_residual, speed=speed,
            exit=Columns(columns),
        )  # fmt: skip

    # fields

    def rectangles(self, pieces: Iterable[tuple[float, float, int, SectionState]]) -> tuple[Array, Array]:
        """Return the rows of sections, layers or those of the thinnest lifts at the mean density of the section.

        Parameters
        ----------
        pieces : iterable of (low, high, strokes, state)
            Ends along the roller [m], number of strokes and section.

        Returns
        -------
        corners : ndarray, shape (rows, 4, 2)
            Positions z and y of the corners [m].
        values : ndarray, shape (3, rows)
            Density ratio [-], lateral stress at rest [Pa] and number of strokes.
        """
        corners, values = [], []
        for low, high, strokes, state in pieces:
            rows, top = [(each.height, each.density_ratio, each.lateral_stress) for each in state.columns], 0.0
            if self.lifts is not None:
                rows = self.thinnest.profile_at(state.density_ratio).T.tolist()
            for height, ratio, stress in rows:
                bottom, top = top, top + height
                corners.append([(low, bottom), (high, bottom), (high, top), (low, top)])
                values.append((ratio, stress, float(strokes)))
        return np.array(corners), np.array(values).T

    def frames(self) -> Iterator[tuple[float, "meshio.Mesh"]]:
        """Yield the number of strokes since the start, and a mesh with the fields of `rectangles`."""
        import meshio

        machine, states, count = self.problem.machine, self.history.states, self.history.count
        for number in np.unique(np.linspace(1, count, min(count, FRAMES_MAX)).round().astype(int)).tolist():
            pieces = [(0.0, machine.roller_length, number, states[number])]
            if machine.strokes is None:
                ends = zip(machine.edges[:number], machine.edges[1:], range(1, number + 1), states[1:], strict=False)
                pieces = [(-FILL_SHARE * machine.roller_length, 0.0, 0, states[0]), *ends]
            corners, values = self.rectangles(pieces)
            points = np.column_stack([corners.reshape(-1, 2), np.zeros(4 * len(corners))])
            names = ("density_ratio", "lateral_stress", "strokes")
            data = {name: [column] for name, column in zip(names, values, strict=True)}
            cells = [("quad", np.arange(len(points)).reshape(-1, 4))]
            yield float(number), meshio.Mesh(points, cells, cell_data=data)
