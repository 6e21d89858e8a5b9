"""Plane-strain finite elements of the compacting layer in small or finite strain.

    internal force on a node = int J sigma grad N dV,    eight-node quadrilaterals with 2 x 2 Gauss points

A displacement increment strains every Gauss point along a straight path, on which the constitutive law is integrated in
substeps (`cap_plasticity.integrate_points`). The error thus depends on the substeps and hardly on the increment.
Reduced integration avoids volumetric locking; its only hourglass mode cannot propagate between elements.

Finite strain: the deformation gradients F before and after an increment give dF = F_after F_before^-1 = R U. The strain
is ln U in the unrotated frame, and the Cauchy stress found there is rotated,

    sigma = R sigma_unrotated R',    J = det F_after.

Small strain: the strain is the symmetric gradient of the displacement increment, without rotation and with J = 1.

Gradients have the components (xx, xy, yx, yy), g_ij = du_i/dx_j, along the second axis; n is the number of points.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg.lapack import dgbtrf, dgbtrs
from skfem import Basis, ElementQuadS2, MeshQuad

from compact.material import cap_plasticity
from compact.material.laws import Compaction
from compact.mesh import RowMesh
from compact.numerics.assembly import element_unknowns, unit_moduli

IDENTITY = np.array([1.0, 0.0, 0.0, 1.0])
SERIES_LIMIT = 1e-4  # [-], half the logarithm of the stretch ratio; below it atanh(z)/z is 1 + z^2/3 to rounding
STRAIN_FROM_GRADIENT = np.array([[1.0, 0, 0, 0], [0, 0, 0, 1.0], [0, 1.0, 1.0, 0]])  # (xx, yy, 2 xy)
TENSOR_FROM_STRESS = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, 0, 1.0], [0, 1.0, 0]])  # of (xx, yy, xy)
GAUSS_ORDER = 3  # [-], polynomial order of 2 x 2 points
SUBSTEPS = 4  # [-], of the stress integration in one increment; 2 leave an error of up to 0.3 % in the resistance
STRAIN_DIFFERENCE = 1e-8  # [-], of the tangent by differences; 1e-5 of the yield strain
IN_PLANE = [0, 1, 3]  # xx, yy, xy
FloatArray = NDArray[np.float64]
LinearSolver = Callable[[FloatArray], FloatArray]
POINT_FIELDS = ("stress", "density_ratio", "max_density_ratio", "plastic_work")  # of a `MaterialPoint`


@dataclass(frozen=True, eq=False)
class SmallIncrement:
    """Increment of small strain.

    Parameters
    ----------
    strain : ndarray, shape (n, 3)
        Strain increment (xx, yy, 2 xy) [-].
    """

    strain: FloatArray

    @classmethod
    def from_gradients(cls, before: FloatArray, after: FloatArray) -> "SmallIncrement":
        """Return the increment between two displacement gradients, shape (n, 4)."""
        return cls((after - before) @ STRAIN_FROM_GRADIENT.T)

    @property
    def volume_ratio(self) -> FloatArray:
        """Volume over reference volume, J = 1 [-], shape (n,)."""
        return np.ones(len(self.strain))

    @property
    def midpoint_volume_ratio(self) -> FloatArray:
        """Volume ratio in the middle of the increment [-], shape (n,)."""
        return self.volume_ratio

    @property
    def inverse_gradient(self) -> FloatArray:
        """Inverse deformation gradient dX/dx = 1 [-], shape (n, 2, 2)."""
        return np.broadcast_to(np.eye(2), (len(self.strain), 2, 2))

    def rotate(self, stress: FloatArray) -> FloatArray:
        """Return the stress (xx, yy, zz, xy) in the axes of the layer [Pa], shape (n, 4)."""
        return stress

    def spatial_tangent(self, stress: FloatArray, tangent: FloatArray) -> FloatArray:
        """Return d(force density)/d(spatial displacement gradient) [Pa], shape (n, 4, 4).

        Parameters
        ----------
        stress : ndarray, shape (n, 4)
            Stress after the increment [Pa]; without effect in small strain.
        tangent : ndarray, shape (n, 3, 3)
            d stress/d strain of (xx, yy, xy) [Pa].
        """
        del stress  # no geometric stiffness in small strain
        return TENSOR_FROM_STRESS @ tangent @ STRAIN_FROM_GRADIENT


@dataclass(frozen=True, eq=False)
class FiniteIncrement:
    """Increment of finite strain.

    Parameters
    ----------
    strain : ndarray, shape (n, 3)
        Logarithmic strain ln U (xx, yy, 2 xy) [-].
    gradient : ndarray, shape (n, 4)
        Deformation gradient F after the increment [-].
    cosine, sine : ndarray, shape (n,)
        Components of the rotation R [-].
    stretch : ndarray, shape (3, n)
        Mean, half difference and xy component of U [-].
    """

    strain: FloatArray
    gradient: FloatArray
    cosine: FloatArray
    sine: FloatArray
    stretch: FloatArray

    @classmethod
    def from_gradients(cls, before: FloatArray, after: FloatArray) -> "FiniteIncrement":
        """Return the increment between two displacement gradients, shape (n, 4), in closed form.

        R is the rotation by the angle of (dF_xx + dF_yy, dF_yx - dF_xy). With the spherical and deviatoric parts m and
        d of U = R' dF, ln U = ln(det U)/2 + atanh(|d|/m)/|d| d.
        """
        F = IDENTITY + after
        xx, xy, yx, yy = (_as_matrix(F) @ _invert(_as_matrix(IDENTITY + before))).reshape(-1, 4).T
        size = np.hypot(xx + yy, yx - xy)
        c, s = (xx + yy) / size, (yx - xy) / size
        stretch = np.array([size / 2, (c * (xx - yy) + s * (yx + xy)) / 2, (c * (xy + yx) + s * (yy - xx)) / 2])
        ratio = np.hypot(*stretch[1:]) / stretch[0]
        safe = np.maximum(ratio, SERIES_LIMIT)
        factor = np.where(ratio > SERIES_LIMIT, np.arctanh(safe) / safe, 1 + ratio**2 / 3) / stretch[0]
        half_volume = np.log(xx * yy - xy * yx) / 2
        strain = [half_volume + factor * stretch[1], half_volume - factor * stretch[1], 2 * factor * stretch[2]]
        return cls(np.array(strain).T, F, c, s, stretch)

    @property
    def volume_ratio(self) -> FloatArray:
        """Volume over reference volume, J [-], shape (n,)."""
        F = self.gradient
        return F[:, 0] * F[:, 3] - F[:, 1] * F[:, 2]

    @property
    def midpoint_volume_ratio(self) -> FloatArray:
        """Volume ratio in the middle of the increment [-], shape (n,)."""
        return self.volume_ratio * np.exp(-(self.strain[:, 0] + self.strain[:, 1]) / 2)

    @property
    def inverse_gradient(self) -> FloatArray:
        """Inverse deformation gradient dX/dx [-], shape (n, 2, 2)."""
        return _invert(_as_matrix(self.gradient))

    def rotate(self, stress: FloatArray) -> FloatArray:
        """Return the stress (xx, yy, zz, xy) in the axes of the layer [Pa], shape (n, 4)."""
        xx, yy, zz, xy = stress.T
        c, s = self.cosine, self.sine
        cross = 2 * c * s * xy
        return np.array(
            [
                c * c * xx + s * s * yy - cross,
                s * s * xx + c * c * yy + cross,
                zz,
                c * s * (xx - yy) + (c * c - s * s) * xy,
            ]
        ).T

    def spatial_tangent(self, stress: FloatArray, tangent: FloatArray) -> FloatArray:
        """Return d(force density)/d(spatial displacement gradient) [Pa], shape (n, 4, 4).

            d(J sigma grad N)/J = [tr(l) sigma + d sigma - sigma l'] grad N

        d ln U is the symmetric part of the spatial gradient l, except for squares of the strain increment. R rotates
        with the skew part of l minus U/m times its shear.

        Parameters
        ----------
        stress : ndarray, shape (n, 4)
            Stress after the increment in the unrotated frame [Pa].
        tangent : ndarray, shape (n, 3, 3)
            d stress/d strain of (xx, yy, xy) in the unrotated frame [Pa].
        """
        n = len(stress)
        sxx, syy, sxy = stress[:, 0], stress[:, 1], stress[:, 3]
        sigma = np.array([sxx, sxy, sxy, syy]).T
        A = TENSOR_FROM_STRESS @ tangent @ STRAIN_FROM_GRADIENT + sigma[:, :, None] * IDENTITY
        a, b = self.stretch[1:] / self.stretch[0]
        spin = np.array([b / 2, (1 - a) / 2, -(1 + a) / 2, -b / 2]).T
        A += np.array([2 * sxy, syy - sxx, syy - sxx, -2 * sxy]).T[:, :, None] * spin[:, None, :]
        for row, column, part in (
            (0, 0, sxx), (0, 1, sxy), (1, 2, sxx), (1, 3, sxy), (2, 0, sxy), (2, 1, syy), (3, 2, sxy), (3, 3, syy),
        ):  # fmt: skip
            A[:, row, column] -= part
        R = np.array([self.cosine, -self.sine, self.sine, self.cosine]).T.reshape(n, 2, 2)
        rotation = np.einsum("nij,nkl->nikjl", R, R).reshape(n, 4, 4)
        return rotation @ A @ rotation.transpose(0, 2, 1)


def _as_matrix(gradient):
    return gradient.reshape(-1, 2, 2)


def _invert(matrix):
    (a, b), (c, d) = matrix.transpose(1, 2, 0)
    return np.array([[d, -b], [-c, a]]).transpose(2, 0, 1) / (a * d - b * c)[:, None, None]


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
    """

    displacement: FloatArray
    points: cap_plasticity.MaterialPoint
    work: FloatArray


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
    rate_factor : float
        Factor of the yield pressure by the speed [-].
    substeps : int
        Substeps of the stress integration in one increment.
    """

    def __init__(
        self,
        mesh: RowMesh | MeshQuad,
        material: Compaction,
        *,
        fixed_dofs: ArrayLike = (),
        finite: bool = True,
        rate_factor: float = 1.0,
        substeps: int = SUBSTEPS,
    ) -> None:
        if not isinstance(mesh, MeshQuad):
            mesh = MeshQuad(np.ascontiguousarray(mesh.points.T), np.ascontiguousarray(mesh.quads.T))
        self.basis = Basis(mesh, ElementQuadS2(), intorder=GAUSS_ORDER)
        self.material, self.rate_factor, self.substeps = material, rate_factor, substeps
        self.finite = finite
        self.kinematics: type[FiniteIncrement] | type[SmallIncrement] = FiniteIncrement if finite else SmallIncrement
        self.element_dofs = element_unknowns(self.basis)
        self.fixed_dofs = np.unique(np.asarray(fixed_dofs, dtype=int))

    @cached_property
    def shape_gradients(self) -> FloatArray:
        """Gradients dN/dX of the shape functions [1/m], shape (elements, points, 8, 2)."""
        grad = np.array([self.basis.basis[j][0].grad for j in range(self.basis.Nbfun)])
        return np.ascontiguousarray(grad.transpose(2, 3, 0, 1))

    @cached_property
    def point_coordinates(self) -> FloatArray:
        """Coordinates of the Gauss points in the reference configuration [m], shape (n, 2)."""
        return np.asarray(self.basis.global_coordinates()).reshape(2, -1).T

    @cached_property
    def point_areas(self) -> FloatArray:
        """Integration weights of the Gauss points in the reference configuration [m2], shape (n,)."""
        return self.basis.dx.ravel()

    def undeformed_state(self) -> SolidState:
        """Return the state of fresh mix without stress and displacement."""
        count = self.point_areas.size
        return SolidState(
            np.zeros((self.basis.N, 2)), cap_plasticity.initial_state(self.material, count), np.zeros(count)
        )

    def displacement_gradient(self, displacement: FloatArray) -> FloatArray:
        """Return du_i/dX_j at the Gauss points, (xx, xy, yx, yy) [-], shape (n, 4).

        Parameters
        ----------
        displacement : ndarray, shape (N, 2)
            Displacement of the nodes [m].
        """
        nodal = displacement[self.basis.element_dofs.T]
        return np.matmul(nodal.transpose(0, 2, 1)[:, None], self.shape_gradients).reshape(-1, 4)

    def increment(self, before: SolidState, displacement: FloatArray, tangent: bool = True) -> "SolidIncrement":
        """Integrate the stresses from a state to a displacement.

        Parameters
        ----------
        before : SolidState
            State before the increment.
        displacement : ndarray, shape (N, 2)
            Displacement of the nodes after the increment [m].
        tangent : bool
            True to compute the tangent too.

        Returns
        -------
        SolidIncrement

        Raises
        ------
        RuntimeError
            If the stress integration fails.
        ValueError
            If elements invert, so that the strain is not finite.
        """
        kinematics = self.kinematics.from_gradients(
            self.displacement_gradient(before.displacement), self.displacement_gradient(displacement)
        )
        points, work = self.integrate_path(before.points, kinematics.strain)
        rotated = cap_plasticity.MaterialPoint(
            kinematics.rotate(points.stress), points.density_ratio, points.max_density_ratio, points.plastic_work
        )
        after = SolidState(displacement, rotated, before.work + kinematics.midpoint_volume_ratio * work)
        moduli = None
        if tangent:
            algorithmic = self._algorithmic_tangent(before.points, kinematics.strain, points)
            moduli = kinematics.spatial_tangent(points.stress, algorithmic)
        return SolidIncrement(self, kinematics, after, moduli)

    def integrate_path(
        self, points: cap_plasticity.MaterialPoint, strain: FloatArray
    ) -> tuple[cap_plasticity.MaterialPoint, FloatArray]:
        """Integrate the constitutive law along a straight strain path.

        Parameters
        ----------
        points : MaterialPoint
            State before the path.
        strain : ndarray, shape (n, 3)
            Strain (xx, yy, 2 xy) of the whole path [-].

        Returns
        -------
        points : MaterialPoint
            State after the path in the unrotated frame.
        work : ndarray, shape (n,)
            Work per volume [J/m3].
        """
        part, work = strain / self.substeps, np.zeros(len(strain))
        for _ in range(self.substeps):
            start = points.stress
            points, _ = cap_plasticity.integrate_points(self.material, points, part, self.rate_factor, tangent=False)
            work += np.sum((start + points.stress)[:, IN_PLANE] * part, axis=1) / 2
        return points, work

    def _algorithmic_tangent(self, before, strain, after):
        """Return d stress/d strain of the whole path, shape (n, 3, 3): by differences at yielding points."""
        if self.substeps == 1:
            return cap_plasticity.integrate_points(self.material, before, strain, self.rate_factor)[1]
        tangent = np.tile(self._elastic_moduli, (len(strain), 1, 1))
        yielding = np.flatnonzero(after.plastic_work != before.plastic_work)
        start = cap_plasticity.MaterialPoint(*(getattr(before, name)[yielding] for name in POINT_FIELDS))
        for k in range(3):
            perturbed = strain[yielding].copy()
            perturbed[:, k] += STRAIN_DIFFERENCE
            change = self.integrate_path(start, perturbed)[0].stress - after.stress[yielding]
            tangent[yielding, :, k] = change[:, IN_PLANE] / STRAIN_DIFFERENCE
        return tangent

    @cached_property
    def _elastic_moduli(self):
        """Elastic d stress/d strain of (xx, yy, xy) [Pa], shape (3, 3)."""
        along, across, shear, lame = self.material.unloading_modulus * unit_moduli(self.material.poisson)
        return np.array([[along + lame, lame, 0], [lame, across + lame, 0], [0, 0, shear]])

    def elastic_element_stiffness(self) -> FloatArray:
        """Return the stiffness of the undeformed elements [N/m2], shape (elements, 16, 16)."""
        undeformed = self.undeformed_state()
        return self.increment(undeformed, undeformed.displacement).element_stiffness

    @cached_property
    def ordered_dofs(self) -> NDArray[np.int64]:
        """Free degrees of freedom, ordered by columns of nodes along x for a narrow matrix band."""
        free = np.setdiff1d(np.arange(2 * self.basis.N), self.fixed_dofs)
        x, y = np.repeat(self.basis.doflocs, 2, axis=1)[:, free]
        return free[np.lexsort((y, np.round(x / np.ptp(x), 9)))]

    @cached_property
    def equation_numbers(self) -> NDArray[np.int64]:
        """Index of each degree of freedom in `ordered_dofs`, -1 if it is fixed."""
        numbers = np.full(2 * self.basis.N, -1)
        numbers[self.ordered_dofs] = np.arange(self.ordered_dofs.size)
        return numbers

    @cached_property
    def _band_layout(self):
        """Half-width of the band, indices of the kept element entries, and their positions in the band matrix."""
        numbers = self.equation_numbers[self.element_dofs]
        rows, columns = np.broadcast_arrays(numbers[:, :, None], numbers[:, None, :])
        kept = np.flatnonzero((rows >= 0) & (columns >= 0))
        rows, columns = rows.ravel()[kept], columns.ravel()[kept]
        width = int(np.abs(rows - columns).max())
        return width, kept, columns * (3 * width + 1) + 2 * width + rows - columns

    def factorise(self, element_stiffness: FloatArray, nodes: ArrayLike, nodal_stiffness: FloatArray) -> LinearSolver:
        """Assemble and factorise the stiffness of the free degrees of freedom.

        LAPACK's banded LU is twice as fast as a sparse one for some thousand unknowns.

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
        RuntimeError
            If the stiffness is singular.
        """
        width, kept, position = self._band_layout
        height, size = 3 * width + 1, self.ordered_dofs.size
        band = np.bincount(position, weights=element_stiffness.ravel()[kept], minlength=height * size)
        numbers = self.equation_numbers[2 * np.asarray(nodes)[:, None] + np.arange(2)]
        rows, columns = np.broadcast_arrays(numbers[:, :, None], numbers[:, None, :])
        free = (rows >= 0) & (columns >= 0)
        band[(columns * height + 2 * width + rows - columns)[free]] += nodal_stiffness[free]
        factors, pivots, info = dgbtrf(band.reshape(size, height).T, width, width, overwrite_ab=1)
        if info:
            raise RuntimeError("the stiffness of the layer is singular to working precision")
        return lambda residual: dgbtrs(factors, width, width, residual, pivots)[0]


@dataclass(frozen=True, eq=False)
class SolidIncrement:
    """Increment of a `FiniteStrainSolid` with its internal forces and stiffness.

    Parameters
    ----------
    solid : FiniteStrainSolid
        Finite elements of the layer.
    kinematics : FiniteIncrement or SmallIncrement
        Strain, rotation and volume change of the Gauss points.
    after : SolidState
        State after the increment.
    tangent : ndarray, shape (n, 4, 4), or None
        Spatial tangent of the Gauss points [Pa].
    """

    solid: FiniteStrainSolid
    kinematics: FiniteIncrement | SmallIncrement
    after: SolidState
    tangent: FloatArray | None

    @cached_property
    def _spatial_gradients(self):
        """Spatial gradients of the shape functions, shape (elements, points, 8, 2), and the areas of the points."""
        gradients = self.solid.shape_gradients
        area = (self.solid.point_areas * self.kinematics.volume_ratio).reshape(self.solid.basis.dx.shape)
        return np.matmul(gradients, self.kinematics.inverse_gradient.reshape(*gradients.shape[:2], 2, 2)), area

    @property
    def internal_forces(self) -> FloatArray:
        """Internal forces of the nodes [N/m], shape (N, 2)."""
        gradients, area = self._spatial_gradients
        xx, yy, _, xy = self.after.points.stress.T.reshape(4, *area.shape) * area
        stress = np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2)
        nodal = np.matmul(gradients, stress).sum(axis=1)
        nodes = self.solid.basis.element_dofs.T.ravel()
        count = self.solid.basis.N
        return np.stack([np.bincount(nodes, nodal[..., i].ravel(), count) for i in range(2)], axis=-1)

    @property
    def element_stiffness(self) -> FloatArray:
        """Stiffness d(internal forces)/d(displacement) of the elements [N/m2], shape (elements, 16, 16)."""
        if self.tangent is None:
            raise ValueError("`tangent` must be computed for the stiffness, got None; use increment(..., tangent=True)")
        gradients, area = self._spatial_gradients
        count, points = area.shape
        G = np.zeros((count, points, 4, 16))
        G[:, :, 0:2, 0::2] = G[:, :, 2:4, 1::2] = gradients.transpose(0, 1, 3, 2)
        AG = np.matmul(self.tangent.reshape(count, points, 4, 4) * area[..., None, None], G)
        return np.matmul(G.reshape(count, -1, 16).transpose(0, 2, 1), AG.reshape(count, -1, 16))
