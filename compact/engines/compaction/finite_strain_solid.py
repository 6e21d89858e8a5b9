"""From displacements to strain increments, small or finite, and what a stress becomes on the way.

Finite: the deformation gradients F before and after an increment give dF = F_after F_before^-1 = R U. Its strain is
ln U, taken in the frame of the mix before the increment; the Cauchy stress found there turns with it,

    sigma = R sigma_turned R',    force on a node = int J sigma grad N dV,    J = det F_after.

Small: the strain is the symmetric gradient of the displacement increment, nothing turns and J = 1.

Gradients have the components (xx, xy, yx, yy), g_ij = du_i/dx_j, along the second axis; all is batched over n points.

A layer of compacting mix in finite elements: what its nodes feel when they are moved.

    residual = int J sigma grad N dV,    eight-node quadrilaterals with 2 x 2 points, plane strain

Every point remembers a `MaterialPoint`; moving the nodes from one displacement to the next strains it along a straight path,
which the mix follows in small steps (`cap.step`), so that the strain between two positions of the roller, not the
step, is what is approximated. Reduced integration keeps flow at constant volume from locking, and its only hourglass
mode cannot pass from one element to the next.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg.lapack import dgbtrf, dgbtrs
from skfem import Basis, ElementQuadS2, MeshQuad

from compact.material import cap_plasticity
from compact.numerics.assembly import element_unknowns, unit_moduli

UNITY = np.array([1.0, 0.0, 0.0, 1.0])
NEARLY_ROUND = 1e-4  # half the logarithm of the stretches' ratio; below it atanh(z)/z is 1 + z^2/3 to rounding
TO_STRAIN = np.array([[1.0, 0, 0, 0], [0, 0, 0, 1.0], [0, 1.0, 1.0, 0]])  # (xx, yy, 2 xy) of a gradient
FROM_STRESS = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, 0, 1.0], [0, 1.0, 0]])  # a tensor of (xx, yy, xy)


@dataclass(frozen=True, eq=False)
class Small:
    """Increment of linear kinematics; `strain` (xx, yy, 2 xy), shape (n, 3)."""

    strain: np.ndarray

    @classmethod
    def between(cls, before, after):
        """The increment between two displacement gradients, shape (n, 4)."""
        return cls((after - before) @ TO_STRAIN.T)

    @property
    def volume(self):
        """Volume over that of the reference, J."""
        return np.ones(len(self.strain))

    @property
    def volume_midway(self):
        """The same in the middle of the increment."""
        return self.volume

    @property
    def pull_back(self):
        """dX/dx, by which gradients over the reference become spatial, shape (n, 2, 2)."""
        return np.broadcast_to(np.eye(2), (len(self.strain), 2, 2))

    def turned(self, stress):
        """The stress (xx, yy, zz, xy) in the axes of the layer."""
        return stress

    def moduli(self, stress, tangent):
        """d(force density) by the spatial gradient of a change of the displacement, shape (n, 4, 4)."""
        return FROM_STRESS @ tangent @ TO_STRAIN


@dataclass(frozen=True, eq=False)
class Finite:
    """Increment of finite kinematics; `strain` ln U (xx, yy, 2 xy), shape (n, 3).

    gradient : F after it, shape (n, 4);  cosine, sine : of R;  stretch : of U, (mean, half difference, xy)
    """

    strain: np.ndarray
    gradient: np.ndarray
    cosine: np.ndarray
    sine: np.ndarray
    stretch: np.ndarray

    @classmethod
    def between(cls, before, after):
        """The increment between two displacement gradients, shape (n, 4), in closed form.

        R turns by the angle of (dF_xx + dF_yy, dF_yx - dF_xy); with m, d the spherical and deviatoric part of
        U = R' dF, ln U = ln(det U)/2 + atanh(|d|/m)/|d| d.
        """
        F = UNITY + after
        xx, xy, yx, yy = (_matrix(F) @ _inverse(_matrix(UNITY + before))).reshape(-1, 4).T
        size = np.hypot(xx + yy, yx - xy)
        c, s = (xx + yy) / size, (yx - xy) / size
        stretch = np.array([size / 2, (c * (xx - yy) + s * (yx + xy)) / 2, (c * (xy + yx) + s * (yy - xx)) / 2])
        ratio = np.hypot(*stretch[1:]) / stretch[0]
        safe = np.maximum(ratio, NEARLY_ROUND)
        rise = np.where(ratio > NEARLY_ROUND, np.arctanh(safe) / safe, 1 + ratio**2 / 3) / stretch[0]
        half_volume = np.log(xx * yy - xy * yx) / 2
        strain = [half_volume + rise * stretch[1], half_volume - rise * stretch[1], 2 * rise * stretch[2]]
        return cls(np.array(strain).T, F, c, s, stretch)

    @property
    def volume(self):
        """Volume over that of the reference, J."""
        F = self.gradient
        return F[:, 0] * F[:, 3] - F[:, 1] * F[:, 2]

    @property
    def volume_midway(self):
        """The same in the middle of the increment."""
        return self.volume * np.exp(-(self.strain[:, 0] + self.strain[:, 1]) / 2)

    @property
    def pull_back(self):
        """dX/dx, by which gradients over the reference become spatial, shape (n, 2, 2)."""
        return _inverse(_matrix(self.gradient))

    def turned(self, stress):
        """The stress (xx, yy, zz, xy) in the axes of the layer."""
        xx, yy, zz, xy = stress.T
        c, s = self.cosine, self.sine
        across = 2 * c * s * xy
        return np.array(
            [
                c * c * xx + s * s * yy - across,
                s * s * xx + c * c * yy + across,
                zz,
                c * s * (xx - yy) + (c * c - s * s) * xy,
            ]
        ).T

    def moduli(self, stress, tangent):
        """d(force density) by the spatial gradient l of a change of the displacement, shape (n, 4, 4).

            d(J sigma grad N)/J = [tr(l) sigma + d sigma - sigma l'] grad N

        seen in the frame before the turn, where `stress` and `tangent` are given. There d ln U is the symmetric part of
        l but for squares of the strain increment, and R spins with the skew part less (U/m) times the shear of l.
        """
        n = len(stress)
        sxx, syy, sxy = stress[:, 0], stress[:, 1], stress[:, 3]
        sigma = np.array([sxx, sxy, sxy, syy]).T
        A = FROM_STRESS @ tangent @ TO_STRAIN + sigma[:, :, None] * UNITY
        a, b = self.stretch[1:] / self.stretch[0]
        spin = np.array([b / 2, (1 - a) / 2, -(1 + a) / 2, -b / 2]).T
        A += np.array([2 * sxy, syy - sxx, syy - sxx, -2 * sxy]).T[:, :, None] * spin[:, None, :]
        for row, column, part in (
            (0, 0, sxx), (0, 1, sxy), (1, 2, sxx), (1, 3, sxy), (2, 0, sxy), (2, 1, syy), (3, 2, sxy), (3, 3, syy),
        ):  # fmt: skip
            A[:, row, column] -= part
        R = np.array([self.cosine, -self.sine, self.sine, self.cosine]).T.reshape(n, 2, 2)
        turn = np.einsum("nij,nkl->nikjl", R, R).reshape(n, 4, 4)
        return turn @ A @ turn.transpose(0, 2, 1)


def _matrix(gradient):
    return gradient.reshape(-1, 2, 2)


def _inverse(matrix):
    (a, b), (c, d) = matrix.transpose(1, 2, 0)
    return np.array([[d, -b], [-c, a]]).transpose(2, 0, 1) / (a * d - b * c)[:, None, None]


GAUSS_ORDER = 3  # 2 x 2 points
SUBSTEPS = 4  # of the mix in one increment: 2 leave up to 0.3 % in the resistance
NEARBY = 1e-8  # strain by which paths differ for their tangent: 1e-5 of what yields
IN_PLANE = [0, 1, 3]  # xx, yy, xy
STATE = ("stress", "density_ratio", "max_density_ratio", "plastic_work")


@dataclass(frozen=True, eq=False)
class Condition:
    """Of a layer: displacement of its nodes, shape (N, 2), `MaterialPoint` of its points, and what they have taken up.

    work : int J sigma : d strain since the mix was fed [J/m3 of the mix as it was fed], shape (n,)
    """

    displacement: np.ndarray
    state: cap_plasticity.MaterialPoint
    work: np.ndarray


class Solid:
    """The elements of a layer on its reference, the fed layer.

    mesh : RowMesh, or any skfem.MeshQuad;  law : Compaction;  finite : strains are finite
    held : unknowns that are not free, indices; node i has the unknowns 2 i and 2 i + 1
    """

    def __init__(self, mesh, law, *, held=(), finite=True, rate_factor=1.0, substeps=SUBSTEPS):
        if not isinstance(mesh, MeshQuad):
            mesh = MeshQuad(np.ascontiguousarray(mesh.points.T), np.ascontiguousarray(mesh.quads.T))
        self.basis = Basis(mesh, ElementQuadS2(), intorder=GAUSS_ORDER)
        self.law, self.rate_factor, self.substeps = law, rate_factor, substeps
        self.finite, self.kinematics = finite, Finite if finite else Small
        self.unknowns = element_unknowns(self.basis)
        self.held = np.unique(np.asarray(held, dtype=int))
        self.free = np.setdiff1d(np.arange(2 * self.basis.N), self.held)

    @cached_property
    def slopes(self):
        """dN/dX of the nodes of each element at its points, shape (elements, points, 8, 2)."""
        grad = np.array([self.basis.basis[j][0].grad for j in range(self.basis.Nbfun)])
        return np.ascontiguousarray(grad.transpose(2, 3, 0, 1))

    @cached_property
    def points(self):
        """Where the points lie on the reference, shape (n, 2)."""
        return np.asarray(self.basis.global_coordinates()).reshape(2, -1).T

    @cached_property
    def area(self):
        """Of the points on the reference, shape (n,)."""
        return self.basis.dx.ravel()

    def at_rest(self):
        """The `Condition` of the mix as it is fed, free of stress."""
        return Condition(
            np.zeros((self.basis.N, 2)),
            cap_plasticity.initial_state(self.law, self.area.size),
            np.zeros(self.area.size),
        )

    def gradient(self, displacement):
        """du_i/dX_j at the points, (xx, xy, yx, yy), shape (n, 4)."""
        nodal = displacement[self.basis.element_dofs.T]
        return np.matmul(nodal.transpose(0, 2, 1)[:, None], self.slopes).reshape(-1, 4)

    def moved(self, before, displacement, tangent=True):
        """The layer moved from the `Condition` before to a displacement, a `Motion`."""
        change = self.kinematics.between(self.gradient(before.displacement), self.gradient(displacement))
        state, work = self._followed(before.state, change.strain)
        turned = cap_plasticity.MaterialPoint(
            change.turned(state.stress), state.density_ratio, state.max_density_ratio, state.plastic_work
        )
        after = Condition(displacement, turned, before.work + change.volume_midway * work)
        slope = self._tangent(before.state, change.strain, state) if tangent else None
        return Motion(self, change, after, change.moduli(state.stress, slope) if tangent else None)

    def _followed(self, state, strain):
        """The state at the end of a straight path of strain, and the work along it."""
        part, work = strain / self.substeps, np.zeros(len(strain))
        for _ in range(self.substeps):
            start = state.stress
            state, _ = cap_plasticity.integrate_points(self.law, state, part, self.rate_factor, tangent=False)
            work += np.sum((start + state.stress)[:, IN_PLANE] * part, axis=1) / 2
        return state, work

    def _tangent(self, before, strain, after):
        """d stress/d strain of the whole path, shape (n, 3, 3): elastic, or by differences where the mix yields."""
        if self.substeps == 1:
            return cap_plasticity.integrate_points(self.law, before, strain, self.rate_factor)[1]
        slope = np.tile(self._elastic, (len(strain), 1, 1))
        yields = np.flatnonzero(after.plastic_work != before.plastic_work)
        start = cap_plasticity.MaterialPoint(*(getattr(before, name)[yields] for name in STATE))
        for k in range(3):
            nearby = strain[yields].copy()
            nearby[:, k] += NEARBY
            change = self._followed(start, nearby)[0].stress - after.stress[yields]
            slope[yields, :, k] = change[:, IN_PLANE] / NEARBY
        return slope

    @cached_property
    def _elastic(self):
        """d stress/d strain inside the cap, shape (3, 3)."""
        along, across, shear, lame = self.law.unloading_modulus * unit_moduli(self.law.poisson)
        return np.array([[along + lame, lame, 0], [lame, across + lame, 0], [0, 0, shear]])

    @cached_property
    def order(self):
        """Free unknowns column by column of nodes along x, which keeps the band of their matrix narrow."""
        x, y = np.repeat(self.basis.doflocs, 2, axis=1)[:, self.free]
        return self.free[np.lexsort((y, np.round(x / np.ptp(x), 9)))]

    @cached_property
    def number(self):
        """Place of each unknown in `order`, -1 where it is held."""
        number = np.full(2 * self.basis.N, -1)
        number[self.order] = np.arange(self.order.size)
        return number

    @cached_property
    def _band(self):
        """Half-width of the band; the entries of the elements that are kept, and where they go."""
        rows, columns = np.broadcast_arrays(
            self.number[self.unknowns][:, :, None], self.number[self.unknowns][:, None, :]
        )
        kept = np.flatnonzero((rows >= 0) & (columns >= 0))
        rows, columns = rows.ravel()[kept], columns.ravel()[kept]
        width = int(np.abs(rows - columns).max())
        return width, kept, columns * (3 * width + 1) + 2 * width + rows - columns

    def factorised(self, blocks, nodes, added):
        """Solver of the free unknowns, in their `order`, for the stiffness of the elements and more at some nodes.

        blocks : shape (elements, 16, 16);  added : on the diagonal blocks of the `nodes`, shape (n, 2, 2)

        LAPACK's banded elimination with pivoting: twice as fast as a sparse one for some thousand unknowns.
        """
        width, kept, place = self._band
        height, size = 3 * width + 1, self.order.size
        band = np.bincount(place, weights=blocks.ravel()[kept], minlength=height * size)
        number = self.number[2 * np.asarray(nodes)[:, None] + np.arange(2)]
        rows, columns = np.broadcast_arrays(number[:, :, None], number[:, None, :])
        free = (rows >= 0) & (columns >= 0)
        band[(columns * height + 2 * width + rows - columns)[free]] += added[free]
        factors, pivots, info = dgbtrf(band.reshape(size, height).T, width, width, overwrite_ab=1)
        if info:
            raise RuntimeError("the stiffness of the layer is singular to working precision")
        return lambda residual: dgbtrs(factors, width, width, residual, pivots)[0]


@dataclass(frozen=True, eq=False)
class Motion:
    """One increment of a `Solid`: the `Condition` after it, and its forces and stiffness."""

    solid: Solid
    change: object
    after: Condition
    moduli: np.ndarray | None

    @cached_property
    def _spatial(self):
        """Spatial slopes of the nodes, shape (elements, points, 8, 2), and the volume of the points."""
        slopes, weight = self.solid.slopes, (self.solid.area * self.change.volume).reshape(self.solid.basis.dx.shape)
        return np.matmul(slopes, self.change.pull_back.reshape(*slopes.shape[:2], 2, 2)), weight

    @property
    def forces(self):
        """That the nodes must bear, shape (N, 2)."""
        slopes, weight = self._spatial
        xx, yy, _, xy = self.after.state.stress.T.reshape(4, *weight.shape) * weight
        stress = np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2)
        nodal = np.matmul(slopes, stress).sum(axis=1)
        dofs = self.solid.basis.element_dofs.T.ravel()
        count = self.solid.basis.N
        return np.stack([np.bincount(dofs, nodal[..., i].ravel(), count) for i in range(2)], axis=-1)

    @property
    def blocks(self):
        """Stiffness of the elements, d forces/d displacement, shape (elements, 16, 16)."""
        slopes, weight = self._spatial
        count, points = weight.shape
        G = np.zeros((count, points, 4, 16))
        G[:, :, 0:2, 0::2] = G[:, :, 2:4, 1::2] = slopes.transpose(0, 1, 3, 2)
        AG = np.matmul(self.moduli.reshape(count, points, 4, 4) * weight[..., None, None], G)
        return np.matmul(G.reshape(count, -1, 16).transpose(0, 2, 1), AG.reshape(count, -1, 16))
