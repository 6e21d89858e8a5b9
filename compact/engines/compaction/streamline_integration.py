"""Material state along the streamlines of steady rolling, integrated from the front to the rear of every row.

    state_j = step(state_(j+1), strain from F_(j+1) to F_j)

Point j + 1 lies upstream of j in the same row of the fed layer; far ahead the mix is in its fed state and F = 1. The
states of a layer thus follow from its displacement alone, in one sweep (Dang Van and Maitournam 1993). So do their
derivatives by the inputs of each point: the state that enters it and the gradients at both ends of the path. The path
is straight in the logarithmic strain of `finite_strain_solid`, and the constitutive law is integrated in substeps.

References
----------
K. Dang Van and M. H. Maitournam, Steady-state flow in classical elastoplasticity: applications to repeated rolling and
sliding contact, J. Mech. Phys. Solids 41 (1993) 1691-1710.
"""

from dataclasses import dataclass

import numpy as np

from compact.engines.compaction.finite_strain_solid import SERIES_LIMIT, FloatArray
from compact.material import cap_plasticity
from compact.material.laws import Compaction
from compact.numerics.jit import compiled

STATE_SIZE = 6  # [-], values of a state: stress (xx, yy, zz, xy), density ratio, preconsolidation density ratio
INPUT_SIZE = 14  # [-], inputs of a point: the state that enters it, the gradient before, the gradient after
DIFFERENCE = 1e-8  # [-], of strain, density ratio and stress over the modulus, for derivatives by differences
MAX_STEPS_PER_CALL = 20_000  # [-], steps of points in one compiled call; some 20 ms, at most 0.5 s


@dataclass(frozen=True, eq=False)
class StreamlineState:
    """States of rows of points, x ascending.

    Parameters
    ----------
    values : ndarray, shape (rows, n, 6)
        Stress (xx, yy, zz, xy) [Pa], density ratio [-], preconsolidation density ratio [-].
    plastic_work : ndarray, shape (rows, n)
        Plastic work in the current volume [J/m3].
    work : ndarray, shape (rows, n)
        Work of deformation, int J sigma : d strain [J/m3 of fed mix].
    """

    values: FloatArray
    plastic_work: FloatArray
    work: FloatArray


@dataclass(frozen=True, eq=False)
class StreamlineIntegrator:
    """Integrator for mix that enters rows of points from the right.

    Parameters
    ----------
    material : Compaction
        Constitutive law.
    fed_points : MaterialPoint
        State of the fed mix, one point for each row.
    rate_factor : float
        Factor of the yield pressure by the speed [-].
    finite : bool
        True for finite strain, False for small strain.
    substeps : int
        Substeps of the path between two points.
    """

    material: Compaction
    fed_points: cap_plasticity.MaterialPoint
    rate_factor: float
    finite: bool
    substeps: int

    def integrate(self, gradients: FloatArray) -> StreamlineState:
        """Integrate the states of all rows.

        Parameters
        ----------
        gradients : ndarray, shape (rows, n, 4)
            Displacement gradients (xx, xy, yx, yy) [-].

        Returns
        -------
        StreamlineState

        Raises
        ------
        RuntimeError
            If elements invert, or the stress integration fails.
        """
        rows, columns = gradients.shape[:2]
        values, works = np.empty((rows, columns, STATE_SIZE)), np.empty((rows, columns, 2))
        inputs = self._law, self._inflow, self.fed_points.plastic_work, gradients
        for block in _row_blocks(rows, columns * self.substeps):
            failed = _integrate_rows(block, *inputs, values, works)
            if failed >= 0:
                row, column = divmod(failed, columns)
                raise RuntimeError(
                    f"the stress integration fails at point {column} of row {row}: elements of the layer invert"
                )
        return StreamlineState(values, works[..., 0], works[..., 1])

    def derivatives(self, gradients: FloatArray, state: StreamlineState) -> FloatArray:
        """Return the derivatives of the values of each point by its inputs, by differences.

        Parameters
        ----------
        gradients : ndarray, shape (rows, n, 4)
            Displacement gradients [-].
        state : StreamlineState
            Their states.

        Returns
        -------
        ndarray, shape (rows, n, 6, 14)
        """
        derivatives = np.empty((*gradients.shape[:2], STATE_SIZE, INPUT_SIZE))
        differences = np.full(INPUT_SIZE, DIFFERENCE)
        differences[:4] *= self.material.unloading_modulus
        rows, columns = gradients.shape[:2]
        for block in _row_blocks(rows, INPUT_SIZE * columns * self.substeps):
            _differentiate_rows(block, self._law, self._inflow, gradients, state.values, differences, derivatives)
        return derivatives

    @property
    def _law(self):
        """Constants of the law, kinematics and substeps for compiled code."""
        return cap_plasticity.cap_constants(self.material, self.rate_factor), self.finite, self.substeps

    @property
    def _inflow(self):
        """Values of the state that enters each row, shape (rows, 6)."""
        return np.column_stack(
            [self.fed_points.stress, self.fed_points.density_ratio, self.fed_points.max_density_ratio]
        )


def propagate_changes(derivatives: FloatArray, gradient_changes: FloatArray) -> FloatArray:
    """Return the changes of all states with changes of the gradients, by the chain rule along the rows.

    Parameters
    ----------
    derivatives : ndarray, shape (rows, n, 6, 14)
        Derivatives of `StreamlineIntegrator`.
    gradient_changes : ndarray, shape (rows, n, 4)
        Changes of the displacement gradients [-].

    Returns
    -------
    ndarray, shape (rows, n, 6)
        Changes of the values of the states.
    """
    changes = np.empty((*gradient_changes.shape[:2], STATE_SIZE))
    gradient_changes = np.ascontiguousarray(gradient_changes)
    for block in _row_blocks(*gradient_changes.shape[:2]):
        _apply_chain_rule(block, derivatives, gradient_changes, changes)
    return changes


def _row_blocks(rows: int, steps_per_row: int) -> list[tuple[int, int]]:
    """Return (first, end) of blocks of rows for one compiled call each; an interrupt is possible between two calls."""
    size = max(MAX_STEPS_PER_CALL // max(steps_per_row, 1), 1)
    return [(first, min(first + size, rows)) for first in range(0, rows, size)]


@compiled
def _integrate_rows(block, law, inflow, plastic_work, gradients, values, works):
    """Integrate a block of rows from their right ends; return the first point that fails, or -1."""
    inputs, columns = np.zeros(INPUT_SIZE), gradients.shape[1]
    for row in range(block[0], block[1]):
        dissipated, work = plastic_work[row], 0.0
        for j in range(columns - 1, -1, -1):
            _gather_inputs(inputs, inflow[row], gradients[row], values[row], j)
            good, dissipation, increment = _integrate_interval(law, inputs, values[row, j])
            if not good:
                return row * columns + j
            dissipated, work = dissipated + dissipation, work + increment
            works[row, j, 0], works[row, j, 1] = dissipated, work
    return -1


@compiled
def _gather_inputs(inputs, inflow, gradients, values, j):
    """Collect the inputs of point j of a row."""
    if j + 1 < len(gradients):
        inputs[:STATE_SIZE] = values[j + 1]
        inputs[STATE_SIZE:10] = gradients[j + 1]
    else:
        inputs[:STATE_SIZE] = inflow
        inputs[STATE_SIZE:10] = 0.0
    inputs[10:] = gradients[j]


@compiled
def _differentiate_rows(block, law, inflow, gradients, values, differences, derivatives):
    """Differentiate the values of every point of a block of rows by its inputs."""
    inputs, perturbed = np.zeros(INPUT_SIZE), np.empty(STATE_SIZE)
    for row in range(block[0], block[1]):
        for j in range(gradients.shape[1]):
            _gather_inputs(inputs, inflow[row], gradients[row], values[row], j)
            for k in range(INPUT_SIZE):
                original = inputs[k]
                inputs[k] = original + differences[k]
                _integrate_interval(law, inputs, perturbed)
                for i in range(STATE_SIZE):
                    derivatives[row, j, i, k] = (perturbed[i] - values[row, j, i]) / differences[k]
                inputs[k] = original


@compiled
def _apply_chain_rule(block, derivatives, gradients, values):
    """Apply the chain rule along each row of a block."""
    inputs = np.zeros(INPUT_SIZE)
    for row in range(block[0], block[1]):
        for j in range(gradients.shape[1] - 1, -1, -1):
            inputs[:10] = 0.0
            if j + 1 < gradients.shape[1]:
                inputs[:STATE_SIZE] = values[row, j + 1]
                inputs[STATE_SIZE:10] = gradients[row, j + 1]
            inputs[10:] = gradients[row, j]
            for i in range(STATE_SIZE):
                total = 0.0
                for k in range(INPUT_SIZE):
                    total += derivatives[row, j, i, k] * inputs[k]
                values[row, j, i] = total


@compiled
def _integrate_interval(law, inputs, after):
    """Write the values after the path between two points; return success, plastic work, and work of the fed volume."""
    constants, finite, substeps = law
    good, strain, volume, cosine, sine = _strain_increment(inputs[6:10], inputs[10:], finite)
    exx, eyy, gamma = strain[0] / substeps, strain[1] / substeps, strain[2] / substeps
    now = (inputs[0], inputs[1], inputs[2], inputs[3], inputs[4], inputs[5])
    plastic_work, work = 0.0, 0.0
    for _ in range(substeps):
        before = now
        converged, now, dissipated, _, _ = cap_plasticity.integrate_point(constants, before, exx, eyy, gamma)
        good = good and converged
        plastic_work += dissipated
        work += ((before[0] + now[0]) * exx + (before[1] + now[1]) * eyy + (before[3] + now[3]) * gamma) / 2
    xx, yy, xy = now[0], now[1], now[3]
    cross = 2 * cosine * sine * xy
    after[0] = cosine * cosine * xx + sine * sine * yy - cross
    after[1] = sine * sine * xx + cosine * cosine * yy + cross
    after[2] = now[2]
    after[3] = cosine * sine * (xx - yy) + (cosine * cosine - sine * sine) * xy
    after[4], after[5] = now[4], now[5]
    return good, plastic_work, volume * work


@compiled
def _strain_increment(before, after, finite):
    """Return validity, strain, midpoint volume ratio, cosine and sine of a `FiniteIncrement` or `SmallIncrement`."""
    if not finite:
        strain = (after[0] - before[0], after[3] - before[3], after[1] + after[2] - before[1] - before[2])
        return True, strain, 1.0, 1.0, 0.0
    axx, axy, ayx, ayy = 1 + after[0], after[1], after[2], 1 + after[3]
    bxx, bxy, byx, byy = 1 + before[0], before[1], before[2], 1 + before[3]
    volume, volume_before = axx * ayy - axy * ayx, bxx * byy - bxy * byx
    xx, xy = (axx * byy - axy * byx) / volume_before, (axy * bxx - axx * bxy) / volume_before
    yx, yy = (ayx * byy - ayy * byx) / volume_before, (ayy * bxx - ayx * bxy) / volume_before
    size = np.hypot(xx + yy, yx - xy)
    c, s = (xx + yy) / size, (yx - xy) / size
    mean, half, cross = size / 2, (c * (xx - yy) + s * (yx + xy)) / 2, (c * (xy + yx) + s * (yy - xx)) / 2
    ratio = np.hypot(half, cross) / mean
    factor = (np.arctanh(ratio) / ratio if ratio > SERIES_LIMIT else 1 + ratio * ratio / 3) / mean
    half_volume = np.log(volume / volume_before) / 2
    strain = (half_volume + factor * half, half_volume - factor * half, 2 * factor * cross)
    return volume > 0 and volume_before > 0, strain, np.sqrt(volume * volume_before), c, s
