"""Surface of an elastic layer on quadratic elements: its compliance, and quadrature over a contact on it.

    u(x) = sum_a N_a(x) u_a,    u_a = u0_a + sum_b S_ab f_b

N_a are the quadratic shape functions of the corner and middle nodes and S_ab the nodal compliance of the layer. The
forces f_b act on the nodes of the loaded zone; u0 is an initial displacement without contact. x ascends. The layer has
unit modulus in plane strain. It is factorised once and condensed to its surface,

    K u = f,   K = int B' c C B dA,   E = 1, c(y) the relative modulus of the plies, quadratic quadrilaterals

A contact needs the columns of K^-1 for unit forces on the loaded nodes, read at all surface nodes. Every modulus,
relaxation spectrum, speed and roller shares them.

**Moving layer.** A layer that is uniform along x, with one relaxation function E(t) of all stresses, deforms as an
elastic layer of unit modulus under the same tractions. Its displacement u at a material point follows from the elastic
displacement w by the creep function J(t) that belongs to E(t),

    u = J_0 w + sum_k J_k z_k,    theta_k dz_k/dt + z_k = w,

with an internal variable z_k per branch. The convolution acts along x and in time only; it commutes with equilibrium,
compatibility and the condition at the base. In steady motion d/dt = -v d/dx in coordinates of the roller, so that
z_k = M_k w with the operator M_k of z - l dz/dx = w, l = v theta_k. M_k is exact for the interpolation of w that it
names.

References
----------
T. Gustafsson and G. D. McBain, scikit-fem, J. Open Source Softw. 5 (2020) 2369; X. S. Li, ACM Trans. Math. Softw. 31
(2005) 302 (SuperLU); N. W. Tschoegl, The phenomenological theory of linear viscoelastic behavior (Springer, 1989):
interconversion of creep and relaxation functions.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import splu
from scipy.special import hyp1f1
from skfem import Basis, ElementQuad2, MeshQuad
from threadpoolctl import threadpool_limits

from compact.engines.spectral.galerkin_system import creep_function
from compact.material.laws import Elastic
from compact.mesh import RowMesh
from compact.numerics import Array
from compact.numerics.assembly import assemble_matrix, assemble_stiffness, element_matrices, strain_matrix, unit_moduli
from compact.rolling_contact import Layer

GAUSS_POINTS = np.polynomial.legendre.leggauss(8)  # per interval between corner nodes, where the pressure is smooth
EDGE_POWER = 3  # [-], the quadrature points cluster at the edges as t^3, which smooths every edge exponent in use
MIN_INTERVAL = 1e-12  # [-], of the contact length; a corner node closer to an edge does not split the quadrature
GAUSS_ORDER = 4  # [-], 3 x 3 points: exact stiffness of rectangles, and three streamlines in each row
WINDOW_ROUNDING = 1e-9  # [-], of the window; rounding must not exclude one of two mirrored nodes
LOAD_BLOCK = 128  # [-], unit forces per triangular solve
LARGEST_INTERVAL = 1e20  # [-], interval over relaxation length, from which the moments are 1 to rounding
SOLVE_TOLERANCE = 1e-9  # [-], residual of a probe solve; above it the reduced pivoting is rejected

Solve = Callable[[Array], Array]
Displacement = Callable[[Array], Array]


def at_rest(x: Array) -> Array:
    """Return no displacement [m] at points x [m], shape (2, q)."""
    return np.zeros((2, len(x)))


def interpolant(nodes: Array, values: Array) -> Displacement:
    """Return the function of x [m] that interpolates displacements [m] of corner and middle nodes, shape (2, n)."""
    return lambda x: values @ shape_matrix(nodes, x).T


@dataclass(frozen=True, eq=False)
class SurfaceCompliance:
    """Nodal compliance of the layer's surface for forces on its loaded zone.

    Parameters
    ----------
    x : ndarray
        Corner and middle nodes of the surface in turn [m], ascending, shape (n,).
    loaded : slice
        The loaded nodes among `x`, m of them; the first and the last one are corners.
    response : ndarray
        Component i of the displacement of node a under a unit force k on loaded node b, `response[i, a, k, b]`,
        shape (2, n, 2, m).
    initial : callable
        Displacement (x, y) without contact [m], shape (2, q), at points x [m].
    stretch_rate : ndarray, optional
        Derivative of the response by the log of a uniform stretch of the layer along x.
    """

    x: Array
    loaded: slice
    response: Array
    initial: Displacement = at_rest
    stretch_rate: Array | None = None

    def displacement(self, forces: Array) -> Array:
        """Displacement of all nodes under forces on the loaded ones, without the initial one; (2, n) or (2, n, j)."""
        return np.einsum("iakb,kb...->ia...", self.response, forces, optimize=True)

    def stretched(self, stretch: float) -> "SurfaceCompliance":
        """Return the response of the layer stretched along x, to first order in the log of the stretch."""
        assert self.stretch_rate is not None  # computed on request
        return replace(self, response=self.response + np.log(stretch) * self.stretch_rate)

    def retarded(self, operator: Array) -> "SurfaceCompliance":
        """Apply an operator of shape (n, n) along the surface to the response to every force."""
        return replace(self, response=np.einsum("ca,iakb->ickb", operator, self.response, optimize=True))


def contact_quadrature(nodes: Array, edges: Array | tuple[float, float]) -> tuple[Array, Array, Array, Array]:
    """Gauss points between two edges [m] of a contact, in intervals that end at the corner nodes [m].

        x = trailing + length sin^2(pi s/2),  s = t^3/(t^3 + (1 - t)^3),  Gauss points even in t

    Returns points and weights [m], the fraction (x - trailing)/length and 1 minus that without cancellation [-].
    """
    trailing, leading = edges
    length = leading - trailing
    corners = nodes[::2]
    inner = (corners - trailing) / length
    breaks = np.concatenate([[0.0], inner[(inner > MIN_INTERVAL) & (inner < 1 - MIN_INTERVAL)], [1.0]])
    s = 2 / np.pi * np.arcsin(np.sqrt(breaks))
    with np.errstate(divide="ignore"):
        t = 1 / (1 + np.cbrt((1 - s) / np.maximum(s, 0)))
    g, w = GAUSS_POINTS
    half = np.diff(t)[:, None] / 2
    t, dt = (t[:-1, None] + half * (1 + g)).ravel(), (half * w).ravel()
    low, high = t**EDGE_POWER, (1 - t) ** EDGE_POWER
    s, rest = low / (low + high), high / (low + high)
    ds = EDGE_POWER * (t * (1 - t)) ** (EDGE_POWER - 1) / (low + high) ** 2
    fraction, complement = np.sin(np.pi / 2 * s) ** 2, np.sin(np.pi / 2 * rest) ** 2
    weight = length * np.pi * np.sin(np.pi / 2 * s) * np.sin(np.pi / 2 * rest) * ds * dt
    return trailing + length * fraction, weight, fraction, complement


def shape_matrix(nodes: Array, x: Array, derivative: bool = False) -> Array:
    """Values of the quadratic shape functions at points x [m], extrapolated at the ends, or slopes [1/m]; (q, n)."""
    corners = nodes[::2]
    element = np.clip(np.searchsorted(corners, x, side="right") - 1, 0, len(corners) - 2)
    size = corners[element + 1] - corners[element]
    z = (x - corners[element]) / size
    slopes = (4 * z - 3) / size, (4 - 8 * z) / size, (4 * z - 1) / size
    values = slopes if derivative else ((1 - z) * (1 - 2 * z), 4 * z * (1 - z), z * (2 * z - 1))
    N = np.zeros((len(x), len(nodes)))
    for place, value in enumerate(values):
        N[np.arange(len(x)), 2 * element + place] = value
    return N


@dataclass(frozen=True, eq=False)
class LayerStiffness:
    """Factorised stiffness of a layer of unit modulus.

    Parameters
    ----------
    basis : skfem.Basis
        Scalar basis of the nodes; component i of node d is unknown 2 d + i.
    lines : ndarray of int
        Nodes of the lines of equal height from the base up, each with x ascending, shape (lines, n).
    free : ndarray of int
        Unknowns that are not held, shape (m,).
    solve : callable
        Displacements of these unknowns under forces on them, shape (m, k).
    """

    basis: Basis
    lines: NDArray[np.intp]
    free: NDArray[np.intp]
    solve: Solve

    @property
    def surface(self) -> NDArray[np.intp]:
        """Nodes of the surface, x ascending, shape (n,)."""
        return self.lines[-1]

    def displacement(self, forces: Array) -> Array:
        """Displacements of the nodes under nodal forces, both of shape (nodes, 2, k)."""
        found = np.zeros((len(forces) * 2, forces.shape[2]))
        with threadpool_limits(1):  # two threads are 3-6 times slower in the triangular solves
            found[self.free] = self.solve(forces.reshape(found.shape)[self.free])
        return found.reshape(forces.shape)


def element_moduli(mesh: RowMesh, poisson: float, layer: Layer) -> Array:
    """Moduli (2 mu, 2 mu, mu, lambda) [-] of the elements for E = 1 times the modulus of their ply, (elements, 4)."""
    relative = layer.stiffness((mesh.y[1:] + mesh.y[:-1]) / 2)
    return np.repeat(relative, mesh.shape[1])[:, None] * unit_moduli(poisson)


@lru_cache(maxsize=2)  # a mesh and its refinement, 0.1 GB; every speed, modulus and spectrum on a mesh shares them
def layer_stiffness(mesh: RowMesh, poisson: float, layer: Layer) -> LayerStiffness:
    """Assemble and factorise the stiffness of a layer; one on a frictionless base is held behind the roller."""
    quads = MeshQuad(np.ascontiguousarray(mesh.points.T), np.ascontiguousarray(mesh.quads.T))
    basis = Basis(quads, ElementQuad2(), intorder=GAUSS_ORDER)
    K = assemble_stiffness(basis, element_moduli(mesh, poisson, layer))
    rows, columns = mesh.shape
    lines = np.empty((2 * rows + 1, 2 * columns + 1), dtype=np.intp)
    for (x, y), nodes in zip(basis.elem.doflocs, basis.element_dofs.reshape(-1, rows, columns), strict=True):
        lines[int(2 * y) :: 2, int(2 * x) :: 2][:rows, :columns] = nodes
    held = lines[0] if layer.base == "bonded" else lines[:, 0]
    free = np.setdiff1d(np.arange(K.shape[0]), np.concatenate([2 * held, 2 * lines[0] + 1]))
    return LayerStiffness(basis, lines, free, _factorised(K[free][:, free].tocsc()))


@lru_cache(maxsize=8)
def surface_compliance(
    mesh: RowMesh, poisson: float, layer: Layer, window: float, sheared: bool, stretch_rate: bool = False
) -> SurfaceCompliance:
    """Condense a layer to its surface, loaded within a half-width `window` [m] of the centre of the mesh.

    Symmetry of a mirrored mesh halves the number of unit forces; `sheared` includes forces along x. A layer on a
    frictionless base is held along x behind the roller, at its lower end; displacements along x then count from the end
    ahead, which is undisturbed. With `stretch_rate` the derivative by the log of a uniform stretch s of
    the mesh along x too,

        du/d ln s = -K^-1 (dK/d ln s) K^-1 f,   f and y fixed
    """
    body = layer_stiffness(mesh, poisson, layer)
    basis, pulled = body.basis, sheared and layer.base == "slip"
    if stretch_rate:
        B, moduli = strain_matrix(basis), element_moduli(mesh, poisson, layer)
        mixed = element_matrices(basis, B, strain_matrix(basis, -1.0, 0.0), moduli)  # strains along x decrease with s
        change = mixed + mixed.transpose(0, 2, 1) + element_matrices(basis, B, B, moduli)  # and areas increase
        stiffness_change = assemble_matrix(basis, change)

    def respond(forces: Array) -> Array:
        """Return displacement of the surface and, if required, its derivative; shape (1 or 2, 2, n, k)."""
        found = [body.displacement(forces)]
        if stretch_rate:
            resisted = stiffness_change @ found[0].reshape(2 * basis.N, -1)
            found.append(-body.displacement(resisted.reshape(found[0].shape)))
        return np.array([each[body.surface].transpose(1, 0, 2) for each in found])

    x = basis.doflocs[0][body.surface]
    inside = np.flatnonzero(np.abs(x[::2] - mesh.centre) <= window * (1 + WINDOW_ROUNDING))
    first, last = 2 * inside[0], 2 * inside[-1] + 1
    count = last - first
    mirrored = count // 2 if mesh.mirrored and not pulled else 0
    loaded = body.surface[first + mirrored : last]
    response = np.zeros((1 + stretch_rate, 2, len(x), 2, count))
    for k in range(0 if sheared else 1, 2):
        for start in range(0, count - mirrored, LOAD_BLOCK):
            some = loaded[start : start + LOAD_BLOCK]
            forces = np.zeros((basis.N, 2, len(some)))
            forces[some, k, np.arange(len(some))] = 1
            response[..., k, mirrored + start : mirrored + start + len(some)] = respond(forces)
    sign = np.array([[1, -1], [-1, 1]])[:, None, :, None]  # mirroring reverses components along x, not along y
    response[..., :mirrored] = (sign * response[:, :, ::-1, :, ::-1])[..., :mirrored]
    if pulled:
        response[:, 0] -= response[:, 0, [-1]]
    return SurfaceCompliance(x, slice(first, last), response[0], stretch_rate=response[1] if stretch_rate else None)


def _factorised(K: csr_matrix) -> Solve:
    """Solver of K x = b whose residual has been verified."""
    symmetric = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 1e-3, "options": {"SymmetricMode": True}}
    probe = np.ones(K.shape[0])
    for options in (symmetric, {}):
        solve = splu(K, **options).solve
        answer = solve(probe)
        if np.abs(K @ answer - probe).max() < SOLVE_TOLERANCE * np.abs(answer).max():  # entries of K are of order one
            return solve
    raise RuntimeError(
        "the stiffness of the layer is singular to working precision; use a mesh with less distorted elements or a "
        "smaller Poisson's ratio"
    )


def steady_creep_operator(x: Array, material: Elastic, speed: float) -> Array:
    """Operator C of u = C w at a speed [m/s], for w quadratic on each element of the nodes x [m], shape (n, n)."""
    instant, *branches = creep_function(material)
    C = instant * np.eye(len(x))
    for share, time in zip(*branches, strict=True):
        C += share * retardation_operator(x, time * speed)
    return C


def retardation_operator(x: Array, length: float) -> Array:
    """Operator M of z = M w with z - length dz/dx = w, for w quadratic between the corners x[::2] [m], shape (n, n).

    The mix flows along -x, the length v theta [m] is positive; z = w at the upstream end.
    """
    flow = -x[::-1]  # ascends downstream
    M = np.zeros((len(x), len(x)))
    M[0, 0] = 1.0
    starts, ends = flow[:-2:2], flow[2::2]
    for place in (1, 2):
        reach = flow[place::2][: len(starts)] - starts
        zeroth, first, second = _exponential_moments(reach / length)
        r, m = reach / (ends - starts), (flow[1::2] - starts) / (ends - starts)  # in units of the element
        first, second = first * r, second * r**2
        of_start, of_end = zeroth - first * (1 + m) / m + second / m, (second - m * first) / (1 - m)
        rows = np.arange(len(starts)) * 2 + place
        for k, weight in enumerate((of_start, (first - second) / (m * (1 - m)), of_end)):
            M[rows, rows - place + k] = weight
    decay_half, decay = np.exp(-(flow[1::2] - starts) / length), np.exp(-(ends - starts) / length)
    for j in range(len(starts)):  # contributions of the elements farther upstream
        M[2 * j + 1] += decay_half[j] * M[2 * j]
        M[2 * j + 2] += decay[j] * M[2 * j]
    return M[::-1, ::-1]


def retarded_along_rows(values: Array, x: Array, length: float) -> Array:
    """Solve z - length dz/dx = values, shape (rows, n, ...), piecewise linear along rows of points x [m]."""
    z = np.empty_like(values)
    z[:, -1] = values[:, -1]
    steps = np.diff(x, axis=1)
    zeroth, first, _ = _exponential_moments(steps / length)
    decay = np.exp(-steps / length)
    shape = (len(x),) + (1,) * (values.ndim - 2)
    for j in range(x.shape[1] - 2, -1, -1):
        old, new = (zeroth - first)[:, j].reshape(shape), first[:, j].reshape(shape)
        z[:, j] = decay[:, j].reshape(shape) * z[:, j + 1] + old * values[:, j + 1] + new * values[:, j]
    return z


def _exponential_moments(y: Array) -> tuple[Array, ...]:
    """int_0^1 r^k y exp(-y (1 - r)) dr = y 1F1(1, k + 2, -y)/(k + 1) for k = 0, 1, 2."""
    y = np.minimum(y, LARGEST_INTERVAL)
    return tuple(y / (k + 1) * hyp1f1(1.0, k + 2.0, -y) for k in range(3))
