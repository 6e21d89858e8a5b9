"""Displacement of the layer's surface on quadratic elements, and quadrature over a contact on it.

    u(x) = sum_a N_a(x) u_a,    u_a = u0_a + sum_b S_ab f_b

N_a are the quadratic shape functions of the corner and middle nodes and S_ab the nodal compliance of the layer. The
forces f_b act on the nodes of the loaded zone; u0 is an initial displacement without contact. x ascends.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from compact.numerics import Array

GAUSS_POINTS = np.polynomial.legendre.leggauss(8)  # per interval between corner nodes, where the pressure is smooth
EDGE_POWER = 3  # [-], the quadrature points cluster at the edges as t^3, which smooths every edge exponent in use
MIN_INTERVAL = 1e-12  # [-], of the contact length; a corner node closer to an edge does not split the quadrature


@dataclass(frozen=True, eq=False)
class NodalField:
    """Displacement at surface nodes, interpolated quadratically.

    Parameters
    ----------
    nodes : ndarray
        x of corner and middle nodes [m], shape (n,).
    values : ndarray
        Displacement (x, y) at the nodes [m], shape (2, n).
    """

    nodes: Array
    values: Array

    def at(self, x: Array) -> Array:
        """Interpolate to points x [m] of shape (q,); shape (2, q)."""
        return self.values @ shape_matrix(self.nodes, x).T


@dataclass(frozen=True, eq=False)
class SurfaceCompliance:
    """Nodal compliance of the layer's surface for forces on its loaded zone.

    Parameters
    ----------
    x : ndarray
        Coordinates of all surface nodes, corners and middles [m], shape (n,).
    first, last : int
        The loaded nodes are `x[first:last]`, m of them; the first and the last one are corners.
    response : ndarray
        Component i of the displacement of node a under a unit force k on loaded node b, `response[i, a, k, b]`,
        shape (2, n, 2, m).
    """

    x: Array
    first: int
    last: int
    response: Array
    initial: NodalField | None = None

    @property
    def loaded(self) -> slice:
        """Loaded nodes among all surface nodes."""
        return slice(self.first, self.last)

    def displacement(self, forces: Array) -> Array:
        """Displacement of all nodes under forces on the loaded ones, without the initial one; (2, n) or (2, n, j)."""
        cases = "j" if forces.ndim == 3 else ""
        return np.einsum(f"iakb,kb{cases}->ia{cases}", self.response, forces, optimize=True)

    def retarded(self, operator: Array) -> "SurfaceCompliance":
        """Apply an operator of shape (n, n) along the surface to the response to every force."""
        return replace(self, response=np.einsum("ca,iakb->ickb", operator, self.response, optimize=True))

    def with_initial(self, displacement: Array) -> "SurfaceCompliance":
        """Add a displacement of the nodes [m], shape (2, n), to the initial one."""
        present = displacement if self.initial is None else self.initial.values + displacement
        return replace(self, initial=NodalField(self.x, present))


class ContactQuadrature(NamedTuple):
    """Quadrature over a contact, all arrays of shape (q,).

    Parameters
    ----------
    x, weight : ndarray
        Points and weights [m].
    fraction, complement : ndarray
        (x - trailing)/length [-], and 1 minus that without cancellation.
    """

    x: Array
    weight: Array
    fraction: Array
    complement: Array


def contact_quadrature(nodes: Array, edges: Array | tuple[float, float]) -> ContactQuadrature:
    """Gauss points between two edges [m] of a contact, in intervals that end at the corner nodes [m].

    x = trailing + length sin^2(pi s/2),  s = t^3/(t^3 + (1 - t)^3),  Gauss points even in t
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
    return ContactQuadrature(trailing + length * fraction, weight, fraction, complement)


def shape_matrix(nodes: Array, x: Array, derivative: bool = False) -> Array:
    """Values of the quadratic shape functions at points x [m], extrapolated at the ends, or slopes [1/m]; (q, n)."""
    element, size, z = _local_coordinate(nodes, x)
    slopes = (4 * z - 3) / size, (4 - 8 * z) / size, (4 * z - 1) / size
    values = slopes if derivative else _shape_functions(z)
    N = np.zeros((len(x), len(nodes)))
    for place, value in enumerate(values):
        N[np.arange(len(x)), 2 * element + place] = value
    return N


def interpolate(nodes: Array, values: Array, x: Array) -> Array:
    """Interpolate nodal values, shape (..., n), quadratically to points x [m] without a matrix, shape (..., q)."""
    element, _, z = _local_coordinate(nodes, x)
    low, middle, high = (values[..., 2 * element + place] * shape for place, shape in enumerate(_shape_functions(z)))
    return low + middle + high


def _local_coordinate(nodes: Array, x: Array) -> tuple[NDArray[np.intp], Array, Array]:
    """Element of each point, its length and the coordinate in it from 0 to 1."""
    corners = nodes[::2]
    element = np.clip(np.searchsorted(corners, x, side="right") - 1, 0, len(corners) - 2)
    size = corners[element + 1] - corners[element]
    return element, size, (x - corners[element]) / size


def _shape_functions(z: Array) -> tuple[Array, Array, Array]:
    return (1 - z) * (1 - 2 * z), 4 * z * (1 - z), z * (2 * z - 1)
