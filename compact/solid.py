"""A layer of compacting mix in finite elements: what its nodes feel when they are moved.

    residual = int J sigma grad N dV,    eight-node quadrilaterals with 2 x 2 points, plane strain

Every point remembers a `State`; moving the nodes from one displacement to the next strains it along a straight path,
which the mix follows in small steps (`cap.step`), so that the strain between two positions of the roller, not the
step, is what is approximated. Reduced integration keeps flow at constant volume from locking, and its only hourglass
mode cannot pass from one element to the next.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg.lapack import dgbtrf, dgbtrs
from skfem import Basis, ElementQuadS2, MeshQuad

from compact import cap
from compact.assembly import element_unknowns, moduli
from compact.deformation import Finite, Small

GAUSS_ORDER = 3  # 2 x 2 points
SUBSTEPS = 4  # of the mix in one increment: 2 leave up to 0.3 % in the resistance
NEARBY = 1e-8  # strain by which paths differ for their tangent: 1e-5 of what yields
IN_PLANE = [0, 1, 3]  # xx, yy, xy
STATE = ("stress", "density_ratio", "hardened", "plastic_work")


@dataclass(frozen=True, eq=False)
class Condition:
    """Of a layer: displacement of its nodes, shape (N, 2), `State` of its points, and what they have taken up.

    work : int J sigma : d strain since the mix was fed [J/m3 of the mix as it was fed], shape (n,)
    """

    displacement: np.ndarray
    state: cap.State
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
        return Condition(np.zeros((self.basis.N, 2)), cap.fed(self.law, self.area.size), np.zeros(self.area.size))

    def gradient(self, displacement):
        """du_i/dX_j at the points, (xx, xy, yx, yy), shape (n, 4)."""
        nodal = displacement[self.basis.element_dofs.T]
        return np.matmul(nodal.transpose(0, 2, 1)[:, None], self.slopes).reshape(-1, 4)

    def moved(self, before, displacement, tangent=True):
        """The layer moved from the `Condition` before to a displacement, a `Motion`."""
        change = self.kinematics.between(self.gradient(before.displacement), self.gradient(displacement))
        state, work = self._followed(before.state, change.strain)
        turned = cap.State(change.turned(state.stress), state.density_ratio, state.hardened, state.plastic_work)
        after = Condition(displacement, turned, before.work + change.volume_midway * work)
        slope = self._tangent(before.state, change.strain, state) if tangent else None
        return Motion(self, change, after, change.moduli(state.stress, slope) if tangent else None)

    def _followed(self, state, strain):
        """The state at the end of a straight path of strain, and the work along it."""
        part, work = strain / self.substeps, np.zeros(len(strain))
        for _ in range(self.substeps):
            start = state.stress
            state, _ = cap.step(self.law, state, part, self.rate_factor, tangent=False)
            work += np.sum((start + state.stress)[:, IN_PLANE] * part, axis=1) / 2
        return state, work

    def _tangent(self, before, strain, after):
        """d stress/d strain of the whole path, shape (n, 3, 3): elastic, or by differences where the mix yields."""
        if self.substeps == 1:
            return cap.step(self.law, before, strain, self.rate_factor)[1]
        slope = np.tile(self._elastic, (len(strain), 1, 1))
        yields = np.flatnonzero(after.plastic_work != before.plastic_work)
        start = cap.State(*(getattr(before, name)[yields] for name in STATE))
        for k in range(3):
            nearby = strain[yields].copy()
            nearby[:, k] += NEARBY
            change = self._followed(start, nearby)[0].stress - after.stress[yields]
            slope[yields, :, k] = change[:, IN_PLANE] / NEARBY
        return slope

    @cached_property
    def _elastic(self):
        """d stress/d strain inside the cap, shape (3, 3)."""
        along, across, shear, lame = self.law.unloading_modulus * moduli(self.law.poisson)
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
