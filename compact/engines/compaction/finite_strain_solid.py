"""Plane-strain finite elements of the compacting layer in small or finite strain.

    internal force on a node = int J sigma grad N dV,    eight-node quadrilaterals with 2 x 2 Gauss points

A displacement increment strains every Gauss point along a straight path, on which the constitutive law is integrated in
substeps (`cap_plasticity.integrate_path`). The error thus depends on the substeps and hardly on the increment.
Reduced integration avoids volumetric locking; its only hourglass mode cannot propagate between elements.

`finite_strain_kernels` has the kinematics and the compiled pass over elements.

Gradients have the components (xx, xy, yx, yy), g_ij = du_i/dx_j, along the second axis; n is the number of points.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import cast

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import get_lapack_funcs
from skfem import Basis, ElementQuadS2, MeshQuad

from compact.engines.compaction.finite_strain_kernels import add_to_band, integrate_elements, multiply_elements
from compact.material import cap_plasticity
from compact.material.laws import Compaction
from compact.mesh import RowMesh
from compact.numerics import Array, IntArray
from compact.numerics.assembly import element_unknowns
from compact.rolling_contact import EquilibriumError

STRAIN_FROM_GRADIENT = np.array([[1.0, 0, 0, 0], [0, 0, 0, 1.0], [0, 1.0, 1.0, 0]])  # (xx, yy, 2 xy)
GAUSS_ORDER = 3  # [-], polynomial order of 2 x 2 points
SUBSTEPS = 4  # [-], of the stress integration in an increment as long as an element; 2 leave 0.3 % in the resistance
PROBE_TOLERANCE = 5e-3  # [-], error of factors in single precision, over the largest displacement
LinearSolver = Callable[[Array], Array]


@dataclass(frozen=True, eq=False)
class SolidState:
    """State of a layer.

    Parameters
    ----------
    displacement : ndarray, shape (N, 2)
        Displacement of the nodes [m].
    points : MaterialPoint
        Material state of the Gauss points.
    work : ndarray, shape (n,)
        Work of deformation since feeding, int J sigma : d strain [J/m3 of fed mix].
    carried_pressure : ndarray, shape (n,), optional
        Pressures that limit shear in the next increment [Pa], see `drucker_prager_cap`; the mix's own by default.
    """

    displacement: Array
    points: cap_plasticity.MaterialPoint
    work: Array
    carried_pressure: Array | None = None


class FiniteStrainSolid:
    """Finite elements of a layer; the reference configuration is the fed layer.

    Parameters
    ----------
    mesh : RowMesh or skfem.MeshQuad
        Quadrilaterals of the reference configuration.
    material : Compaction
        Constitutive law.
    fixed_dofs : array_like of int
        Prescribed degrees of freedom; node i has 2 i and 2 i + 1.
    finite : bool
        True for finite strain, False for small strain.
    substeps : int
        Substeps of the stress integration in one increment.

    Attributes
    ----------
    rate_factor : float
        Factor of the yield pressure by the speed [-]; 1 until it is set.
    travel : float
        Travel of the roller in one increment [m], over which a shear viscosity acts.
    air_forces : ndarray, shape (elements, 16), or None
        Nodal forces of pore air in the elements [N/m], of the total stress.
    """

    def __init__(
        self,
        mesh: RowMesh | MeshQuad,
        material: Compaction,
        *,
        fixed_dofs: ArrayLike = (),
        finite: bool = True,
        substeps: int = SUBSTEPS,
    ) -> None:
        if not isinstance(mesh, MeshQuad):
            mesh = MeshQuad(np.ascontiguousarray(mesh.points.T), np.ascontiguousarray(mesh.quads.T))
        self.basis = Basis(mesh, ElementQuadS2(), intorder=GAUSS_ORDER)
        self.material, self.finite, self.substeps = material, finite, substeps
        self.rate_factor, self.travel = 1.0, np.inf
        self.air_forces: Array | None = None
        self.element_dofs = element_unknowns(self.basis)
        self.fixed_dofs = np.unique(np.asarray(fixed_dofs, dtype=int))

    @cached_property
    def shape_gradients(self) -> Array:
        """Gradients dN/dX of the shape functions [1/m], shape (elements, points, 8, 2)."""
        grad = np.array([self.basis.basis[j][0].grad for j in range(self.basis.Nbfun)])
        return np.ascontiguousarray(grad.transpose(2, 3, 0, 1))

    @cached_property
    def point_coordinates(self) -> Array:
        """Coordinates of the Gauss points in the reference configuration [m], shape (n, 2)."""
        return np.asarray(self.basis.global_coordinates()).reshape(2, -1).T

    @cached_property
    def point_areas(self) -> Array:
        """Integration weights of the Gauss points in the reference configuration [m2], shape (n,)."""
        return self.basis.dx.ravel()

    def yield_pressure(self, density_ratio: Array) -> Array:
        """Return the yield pressure [Pa] at densest states [-]."""
        return np.asarray(self.material.yield_pressure(density_ratio) * self.rate_factor)

    def undeformed_state(self) -> SolidState:
        """Return the state of fresh mix without stress and displacement."""
        points = cap_plasticity.initial_state(self.material, self.point_areas.size)
        return SolidState(np.zeros((self.basis.N, 2)), points, np.zeros(self.point_areas.size))

    def displacement_gradient(self, displacement: Array) -> Array:
        """Return du_i/dX_j at the Gauss points, (xx, xy, yx, yy) [-], shape (n, 4).

        Parameters
        ----------
        displacement : ndarray, shape (N, 2)
            Displacement of the nodes [m].
        """
        nodal = displacement[self.basis.element_dofs.T]
        return np.matmul(nodal.transpose(0, 2, 1)[:, None], self.shape_gradients).reshape(-1, 4)

    def volume_ratio(self, displacement: Array) -> Array:
        """Return J of the Gauss points; 1 plus the change of area in small strain."""
        gradient = self.displacement_gradient(displacement)
        if self.finite:
            return (1 + gradient[:, 0]) * (1 + gradient[:, 3]) - gradient[:, 1] * gradient[:, 2]
        return 1 + gradient[:, 0] + gradient[:, 3]

    def increment(
        self, before: SolidState, displacement: Array, tangent: bool = True, near: "SolidIncrement | None" = None
    ) -> "SolidIncrement":
        """Integrate the stresses from a state to a displacement.

        Parameters
        ----------
        before : SolidState
            State before the increment.
        displacement : ndarray, shape (N, 2)
            Displacement of the nodes after the increment [m].
        tangent : bool
            True to compute the tangent too.
        near : SolidIncrement, optional
            Similar increment on this mesh, whose multipliers are the initial guess of the return mappings.

        Returns
        -------
        SolidIncrement

        Raises
        ------
        ValueError
            If elements invert, or the stress integration fails.
        """
        points = before.points
        fields = (points.stress, points.density_ratio, points.max_density_ratio, points.plastic_work, before.work)
        displacements = tuple(np.ascontiguousarray(values) for values in (before.displacement, displacement))
        state = tuple(np.ascontiguousarray(values) for values in fields)
        after = tuple(np.empty_like(values) for values in state)
        elements, size = self.element_dofs.shape
        forces, stiffness = np.empty((elements, size)), np.empty((elements if tangent else 0, size, size))
        multipliers = np.zeros((len(before.work), self.substeps)) if near is None else near.multipliers.copy()
        constants = cap_plasticity.cap_constants(self.material, self.rate_factor, self.travel)
        law = constants, constants.line or None, self.finite
        carried = np.empty(0) if before.carried_pressure is None else np.ascontiguousarray(before.carried_pressure)
        guesses, results = (multipliers, carried), (forces, stiffness)
        mesh = np.ascontiguousarray(self.basis.element_dofs.T), self.shape_gradients, self.point_areas
        failed = integrate_elements(law, mesh, displacements, state, after, guesses, results)
        if failed >= 0:
            raise ValueError(
                "`displacement` must not invert elements, got one in which the stress integration fails at point "
                f"{failed}, {self.point_coordinates[failed]} m"
            )
        points = cap_plasticity.MaterialPoint(*after[:4])
        end = SolidState(displacement, points, after[4], before.carried_pressure)
        forces = forces if self.air_forces is None else forces - self.air_forces
        internal = np.bincount(self.element_dofs.ravel(), forces.ravel(), 2 * self.basis.N)  # floats, as it has weights
        return SolidIncrement(end, multipliers, cast(Array, internal.reshape(-1, 2)), stiffness)

    @cached_property
    def ordered_dofs(self) -> IntArray:
        """Free degrees of freedom, ordered by columns of nodes along x for a narrow matrix band."""
        free = np.setdiff1d(np.arange(2 * self.basis.N), self.fixed_dofs)
        x, y = np.repeat(self.basis.doflocs, 2, axis=1)[:, free]
        return free[np.lexsort((y, np.round(x / np.ptp(x), 9)))]

    @cached_property
    def equation_numbers(self) -> IntArray:
        """Index of each degree of freedom in `ordered_dofs`, -1 if it is fixed."""
        numbers = np.full(2 * self.basis.N, -1)
        numbers[self.ordered_dofs] = np.arange(self.ordered_dofs.size)
        return numbers

    @cached_property
    def _band_layout(self):
        """Half-width of the band, and the equations of the elements, -1 for none."""
        numbers = self.equation_numbers[self.element_dofs]
        first = np.where(numbers >= 0, numbers, numbers.max()).min(axis=1)
        return int((numbers.max(axis=1) - first).max()), numbers

    def multiply(self, element_stiffness: Array, vector: Array) -> Array:
        """Multiply the assembled stiffness of the free degrees of freedom by a vector in the order of `ordered_dofs`.

        Parameters
        ----------
        element_stiffness : ndarray, shape (elements, 16, 16)
            Stiffness of the elements [N/m2].
        vector : ndarray, shape (n,)
            Displacements [m].
        """
        return np.asarray(multiply_elements(element_stiffness, self._band_layout[1], vector))

    def factorise(self, element_stiffness: Array, nodes: ArrayLike, nodal_stiffness: Array) -> LinearSolver:
        """Assemble and factorise the stiffness of the free degrees of freedom.

        LAPACK's banded LU is twice as fast as a sparse one for some thousand unknowns. Its factors have single
        precision if they solve a problem with a known solution to PROBE_TOLERANCE, else double precision.

        Parameters
        ----------
        element_stiffness : ndarray, shape (elements, 16, 16)
            Stiffness of the elements [N/m2].
        nodes : array_like of int, shape (n,)
            Nodes with an additional stiffness.
        nodal_stiffness : ndarray, shape (n, 2, 2)
            Their additional diagonal blocks [N/m2].

        Returns
        -------
        callable
            Solver for right-hand sides in the order of `ordered_dofs`.

        Raises
        ------
        EquilibriumError
            If the stiffness is singular.
        """
        nodal_numbers = self.equation_numbers[2 * np.asarray(nodes)[:, None] + np.arange(2)]
        parts = (element_stiffness, self._band_layout[1]), (nodal_stiffness, nodal_numbers)
        probe = np.random.default_rng(0).uniform(-1, 1, self.ordered_dofs.size)  # excites all modes
        product = sum(multiply_elements(*part, probe) for part in parts)
        solve = self._factorise_band(parts, np.float32)
        if solve is None or not np.linalg.norm(solve(product) - probe, np.inf) < PROBE_TOLERANCE:
            solve = self._factorise_band(parts, np.float64)
        if solve is None:
            raise EquilibriumError("no equilibrium: the stiffness of the layer is singular to working precision")
        return solve

    def _factorise_band(self, parts, precision) -> LinearSolver | None:
        """Return the solver for a sum of element matrices in single or double precision, or None if it is singular."""
        width = self._band_layout[0]
        band = np.zeros((self.ordered_dofs.size, 3 * width + 1), precision)
        for matrices, numbers in parts:
            add_to_band(matrices, numbers, width, band)
        factorise, solve = get_lapack_funcs(("gbtrf", "gbtrs"), (band,))
        factors, pivots, info = factorise(band.T, width, width, overwrite_ab=1)
        if info:
            return None
        return lambda residual: solve(factors, width, width, residual.astype(precision), pivots)[0].astype(float)


@dataclass(frozen=True, eq=False)
class SolidIncrement:
    """Increment of a `FiniteStrainSolid` with its internal forces and stiffness.

    Parameters
    ----------
    after : SolidState
        State after the increment.
    multipliers : ndarray, shape (n, substeps)
        Unknowns of the return mappings [-].
    internal_forces : ndarray, shape (N, 2)
        Internal forces of the nodes [N/m].
    element_stiffness : ndarray, shape (elements, 16, 16), or (0, 16, 16) without tangent
        Stiffness d(internal forces)/d(displacement) of the elements [N/m2].
    """

    after: SolidState
    multipliers: Array
    internal_forces: Array
    element_stiffness: Array
