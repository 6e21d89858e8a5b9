"""Load and resistance of a roller row from lumped lifts, by integrals over the strokes of the columns.

    P_row = sum_n P(k_n) dz_n,    F_row = v_form T sum_n (F/t)(k_n) t_n

The strokes n have the mean density k_n, the length dz_n along the roller and the make-up t_n of the columns: the mean
density follows from the balance of mix, whatever the model. P and F/t come from lumped lifts as functions of the mean
density, the first at that behind a stroke, the second at the mean of both sides. Between lifts their logarithms are
interpolated; beyond the last lift they are extrapolated, and the share of the result that is extrapolated is stated.

With several thicknesses of the lifts, P and F/t are extrapolated linearly in the thickness to t_n at every density.
Errors, added as independent ones: the difference to a parabola through three thicknesses; the finest mesh less the
limit of vanishing elements, of first order in 1/increments; without other meshes the estimate of the engine.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from compact.engines.process.confined_floor import confined_stress
from compact.engines.process.lumped_lifts import LiftSequence
from compact.engines.process.roller_row import RollerRow
from compact.numerics import Array

SINGLE_LUMPING_ERROR = {"load": 0.05, "resistance": 0.4}  # [-], of lifts of one thickness; difference to three


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
        Lifts; those with the least increments have different thicknesses, those of one thickness different increments.
    rate_scale : float
        Rate factor of the strokes over that of the lifts [-], to which their forces are in proportion.
    """

    row: RollerRow
    sequences: tuple[LiftSequence, ...]
    rate_scale: float = 1.0

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
        weights = self.row.problem.machine.advance * self.row.history.make_up
        machine = self.row.problem.machine
        return self._estimate("resistance", weights * (machine.stroke_shares if machine.strokes is None else 1.0))

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
            Degree of the polynomial in the thickness; less than the number of sequences.
        """
        states = np.array([state.density_ratio for state in self.row.history.states])
        density = states[1:] if name == "load" else (states[:-1] + states[1:]) / 2
        table = self.rate_scale * np.array([_interpolated(sequence, name, density) for sequence in sequences])
        if len(sequences) == 1:
            return table[0]
        thickness = np.array([sequence.thickness for sequence in sequences])
        powers = np.arange(degree, -1, -1)[:, None]
        return np.sum(np.polyfit(thickness, table, degree) * self.row.history.make_up**powers, axis=0)

    def _estimate(self, name: str, weights: Array) -> Estimate:
        lumpings, meshes = self.lumpings, self.meshes
        forces = self.at_strokes(name, lumpings)
        value = float(forces @ weights)
        if value == 0:
            return Estimate(0.0, 0.0, 0.0, 0.0)
        lumping = SINGLE_LUMPING_ERROR[name]
        if len(lumpings) > 1:  # parabola of three thicknesses, or no extrapolation of two
            other = self.at_strokes(name, lumpings, 2) if len(lumpings) > 2 else self.at_strokes(name, lumpings[:1])
            lumping = abs(float(other @ weights) / value - 1)
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


def _interpolated(sequence: LiftSequence, name: str, density: Array) -> Array:
    """Interpolate P, or F over the thickness, of a sequence at mean densities, linearly in the logarithm."""
    ratio, force = sequence.values("density_ratio"), np.log(sequence.values(name))
    if name == "resistance":
        ratio, force = (ratio + sequence.values("density_before")) / 2, force - np.log(sequence.thickness)
    if len(ratio) == 1:
        return np.full(len(density), np.exp(force[0]))
    inside = np.interp(density, ratio, force)
    first, last = (force[1] - force[0]) / (ratio[1] - ratio[0]), (force[-1] - force[-2]) / (ratio[-1] - ratio[-2])
    below, above = np.minimum(density - ratio[0], 0.0), np.maximum(density - ratio[-1], 0.0)
    return np.exp(inside + first * below + last * above)


def _engine_error(sequence: LiftSequence, name: str) -> float:
    """Return the mean error estimate of the engine, weighted by the force [-]."""
    return float(np.average(sequence.values(f"{name}_error"), weights=sequence.values(name)))
