"""Load and resistance of a roller row from lumped lifts, by integrals over the strokes of the columns.

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
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from compact.engines.process.confined_floor import confined_stress
from compact.engines.process.lumped_lifts import LiftSequence
from compact.engines.process.roller_row import RollerRow
from compact.numerics import Array


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
        by_thickness: dict[float, list[LiftSequence]] = {}
        for sequence in self.sequences:
            by_thickness.setdefault(sequence.thickness, []).append(sequence)
        most = max(by_thickness.values(), key=len)
        return tuple(sorted(most, key=lambda sequence: -sequence.increments))

    @property
    def load(self) -> Estimate:
        """Load of the roller [N]."""
        return self._estimate("load", self.row.lengths)

    @property
    def resistance(self) -> Estimate:
        """Resistance of the roller [N]; 0 of a mould at rest, whose work per stroke is not that of the row."""
        return self._estimate("resistance", self._feed_weights)

    @property
    def _feed_weights(self) -> Array:
        """Mix that each stroke presses over the advance of the mould [m2], of the last stroke its share."""
        machine = self.row.problem.machine
        shares = machine.stroke_shares if machine.strokes is None else 1.0
        return np.asarray(machine.advance * self.row.history.make_up * shares)

    @property
    def air_load(self) -> Estimate:
        """Load by the excess pressure of the pore air [N]; 0 without air."""
        return self._air_estimate("air_load", self.row.lengths)

    @property
    def air_resistance(self) -> Estimate:
        """Resistance by the excess pressure of the pore air [N]; 0 without air, and of a mould at rest."""
        return self._air_estimate("air_resistance", self._feed_weights)

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
        advance = self.row.problem.machine.advance
        return self.resistance.value / (advance * self.row.product_height) if advance else float("nan")

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
        table = self.rate_scale * np.array([_interpolated(sequence, name, density) for sequence in sequences])
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

    def _estimate(self, name: str, weights: Array) -> Estimate:
        lumpings, meshes = self.lumpings, self.meshes
        forces = self.at_strokes(name, lumpings)
        value = float(forces @ weights)
        if value == 0:
            return Estimate(0.0, 0.0, 0.0, 0.0)
        others = [self.at_strokes(name, lumpings, degree) for degree in ((0, 2) if len(lumpings) > 2 else (0,))]
        lumping = max(abs(float(other @ weights) / value - 1) for other in others)
        mesh_limit = 1.0
        if len(meshes) > 1:
            sums = [float(self.at_strokes(name, [sequence]) @ weights) for sequence in meshes]
            size = [1 / sequence.increments for sequence in meshes]
            limit = float(np.polyfit(size, sums, 1)[1])
            coarsest = sums[-1]
            mesh_limit, mesh = limit / coarsest, abs(limit / sums[0] - 1)
        else:
            mesh = _engine_error(lumpings[0], name)
        densest = min(sequence.values("density_ratio").max() for sequence in lumpings)
        beyond = self.row.history.density_ratio > densest
        share = float(forces[beyond] @ weights[beyond]) / value
        return Estimate(value * mesh_limit, lumping, mesh, share)

    def _air_estimate(self, name: str, weights: Array) -> Estimate:
        """Return a force of the air by the thinnest lifts, with the differences to the thickest and between meshes."""
        density, made_up = self._densities(name), self.row.history.make_up

        def total(sequence: LiftSequence) -> float:
            force = np.interp(density, _densities_of(sequence, name), _over_thickness(sequence, name))
            per_feed = 1.0 if name == "air_load" else sequence.thickness
            return float(force * made_up / per_feed @ weights) * self.air_scale

        value, thickest = total(self.lumpings[0]), total(self.lumpings[-1])
        if not value:
            return Estimate(0.0, 0.0, 0.0, 0.0)
        meshes = [total(sequence) for sequence in self.meshes]
        return Estimate(value, abs(thickest / value - 1), abs(meshes[-1] / meshes[0] - 1), 0.0)


def _interpolated(sequence: LiftSequence, name: str, density: Array) -> Array:
    """Interpolate P, or F over the thickness, of a sequence at mean densities, linearly in the logarithm."""
    ratio = _densities_of(sequence, name)
    force = np.log(sequence.values(name) if name == "load" else _over_thickness(sequence, name))
    if len(ratio) == 1:
        return np.full(len(density), np.exp(force[0]))
    inside = np.interp(density, ratio, force)
    first, last = (force[1] - force[0]) / (ratio[1] - ratio[0]), (force[-1] - force[-2]) / (ratio[-1] - ratio[-2])
    below, above = np.minimum(density - ratio[0], 0.0), np.maximum(density - ratio[-1], 0.0)
    return np.exp(inside + first * below + last * above)


def _densities_of(sequence: LiftSequence, name: str) -> Array:
    """Return the mean density ratios of the lifts to which a force belongs [-], as of the strokes."""
    ratio = sequence.values("density_ratio")
    return ratio if name.endswith("load") else (ratio + sequence.values("density_before"))[_fed(sequence)] / 2


def _over_thickness(sequence: LiftSequence, name: str) -> Array:
    """Return a force of the lifts over their thickness [N/m2]; of a load, over that of the sequence."""
    if name.endswith("load"):
        return sequence.values(name) / sequence.thickness
    fed = _fed(sequence)
    return np.asarray(sequence.values(name)[fed] / sequence.values("thickness")[fed])


def _fed(sequence: LiftSequence) -> Array:
    """Return which passes press a lift; a section pressed without one has no work per mix."""
    return np.asarray(sequence.values("thickness") > 0)


def _engine_error(sequence: LiftSequence, name: str) -> float:
    """Return the mean error estimate of the engine, weighted by the force [-]."""
    return float(np.average(sequence.values(f"{name}_error"), weights=sequence.values(name)))
