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

from compact.engines.compaction.finite_strain_kernels import (
    INPUTS,
    VALUES,
    integrate_interval,
    rotate_derivatives,
    strain_derivatives,
)
from compact.engines.compaction.finite_strain_solid import FloatArray
from compact.material import cap_plasticity
from compact.material.laws import Compaction
from compact.numerics.jit import compiled

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
        values, works = np.empty((rows, columns, VALUES)), np.empty((rows, columns, 2))
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
        """Return the derivatives of the values of each point by its inputs.

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
        derivatives = np.empty((*gradients.shape[:2], VALUES, INPUTS))
        rows, columns = gradients.shape[:2]
        for block in _row_blocks(rows, 3 * columns * self.substeps):
            _differentiate_rows(block, self._law, self._inflow, gradients, state.values, derivatives)
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
    changes = np.empty((*gradient_changes.shape[:2], VALUES))
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
    constants, finite, substeps = law
    columns, no_derivatives, multipliers = gradients.shape[1], np.empty((VALUES, 0)), np.empty(substeps)
    for row in range(block[0], block[1]):
        dissipated, work = plastic_work[row], 0.0
        for j in range(columns - 1, -1, -1):
            before, start, end = _inputs(inflow[row], gradients[row], values[row], j)
            multipliers[:] = 0.0
            good, after, dissipation, increment, _ = integrate_interval(
                (constants, finite), before, start, end, multipliers, no_derivatives
            )
            if not good:
                return row * columns + j
            for i in range(VALUES):
                values[row, j, i] = after[i]
            dissipated, work = dissipated + dissipation, work + increment
            works[row, j, 0], works[row, j, 1] = dissipated, work
    return -1


@compiled
def _inputs(inflow, gradients, values, j):
    """Return the values before point j of a row, and the gradients before and after, as tuples."""
    here = gradients[j]
    after = (here[0], here[1], here[2], here[3])
    if j + 1 < len(gradients):
        state, there = values[j + 1], gradients[j + 1]
        before = (there[0], there[1], there[2], there[3])
    else:
        state, before = inflow, (0.0, 0.0, 0.0, 0.0)
    return (state[0], state[1], state[2], state[3], state[4], state[5]), before, after


@compiled
def _differentiate_rows(block, law, inflow, gradients, values, derivatives):
    """Differentiate the values of every point of a block of rows by its inputs."""
    constants, finite, substeps = law
    path_derivatives, kinematics, multipliers = np.empty((VALUES, VALUES + 3)), np.empty((4, 8)), np.empty(substeps)
    for row in range(block[0], block[1]):
        for j in range(gradients.shape[1]):
            before, start, end = _inputs(inflow[row], gradients[row], values[row], j)
            multipliers[:] = 0.0
            _, after, _, _, frame = integrate_interval(
                (constants, finite), before, start, end, multipliers, path_derivatives
            )
            strain_derivatives(start, end, finite, kinematics)
            rotate_derivatives(after, frame, path_derivatives, kinematics, 0, derivatives[row, j])


@compiled
def _apply_chain_rule(block, derivatives, gradients, values):
    """Apply the chain rule along each row of a block."""
    inputs = np.zeros(INPUTS)
    for row in range(block[0], block[1]):
        for j in range(gradients.shape[1] - 1, -1, -1):
            inputs[:10] = 0.0
            if j + 1 < gradients.shape[1]:
                inputs[:VALUES] = values[row, j + 1]
                inputs[VALUES:10] = gradients[row, j + 1]
            inputs[10:] = gradients[row, j]
            for i in range(VALUES):
                total = 0.0
                for k in range(INPUTS):
                    total += derivatives[row, j, i, k] * inputs[k]
                values[row, j, i] = total
