"""One contact patch with free edges on a surface whose response to nodal forces is known.

The pressure lives on trailing < x < leading and vanishes at both edges with the exponents of sliding contact,

    p = xi^alpha (1 - xi)^(1 - alpha) [c_0 T_0 + ... + c_(n-1) T_(n-1)](2 xi - 1),   xi = (x - trailing)/length.

The surface follows the roller, tested with functions that may be singular at an edge. For wrong edges the solution
needs a pressure that is singular there too, by two amplitudes; Newton moves the edges until both vanish: neither
pulled nor pierced, the unilateral contact, with edges that no mesh confines. x ascends, whichever way the roller goes.
"""

from dataclasses import dataclass, replace

import numpy as np

GAUSS = np.polynomial.legendre.leggauss(8)  # between two neighbouring corners; the pressure is smooth there
EDGE_POWER = 3  # quadrature points crowd at the edges as t^3, which smooths every edge exponent in use
AT_EDGE = 1e-12  # of the contact length: corners nearer to an edge leave no interval to integrate over
EDGE_TOLERANCE = 1e-9  # of the contact length
FIRST_TERMS = 6  # of the first settling, smooth in the edges, from which those with more terms start
MORE = 2.0  # times as many terms at most in the next settling: the edges of many terms are found from near only
NODES_PER_TERM = 3  # under the contact; more terms than that see single nodes
FEWER = 2  # terms left out of the second opinion on the peak pressure: its scatter changes sign with every second term
PEAK_SAMPLES = 2001
NARROWEST = 1e-6  # of the loaded zone: length of a contact that its mesh can hold
STEP = 0.25  # of the contact length: farthest that an edge moves at once
ITERATIONS = 60  # which halves from `PATIENCE` on need thirty of
LAST = 4  # iterations that a failure gives
PATIENCE = 12  # whole steps, after which halves: they stay on one side of a kink, where an edge passes a node


class UnresolvedError(RuntimeError):
    """No contact was found on this mesh with so many terms of the pressure; finer ones may find it."""


class BeyondWindowError(UnresolvedError):
    """The contact reaches nodes whose response is not known."""


@dataclass(frozen=True, eq=False)
class Surface:
    """x of its nodes, corners and middles, shape (n,), and displacement under unit forces on x[first:last].

    response : component i of node a under force k on loaded node b, [i, a, k, b], shape (2, n, 2, m)
    """

    x: np.ndarray
    first: int
    last: int
    response: np.ndarray


@dataclass(frozen=True, eq=False)
class Roll:
    """The rigid profile, how deep it stands, and its traction f p along +x on the surface.

    radius, indentation : R, delta [m];  profile : "parabola", "circle", "deformed";  friction : f, signed
    exponent : alpha, of the pressure at the trailing side, 1 - alpha at the leading side
    """

    radius: float
    indentation: float
    profile: str
    friction: float
    exponent: float

    def touch(self, x, displacement):
        """Normal n towards the surface, shape (2, q), and depth d, shape (q,): contact is n.u = d, to first order."""
        R = self.radius
        if self.profile == "deformed":
            ray = np.array([x, np.zeros_like(x)]) + displacement - np.array([[0.0], [R - self.indentation]])
            distance = np.hypot(*ray)
            normal = ray / distance
            return normal, np.sum(normal * displacement, axis=0) - (distance - R)
        drop = x**2 / (2 * R) if self.profile == "parabola" else x**2 / (R + np.sqrt(np.maximum(R**2 - x**2, 0)))
        return np.array([np.zeros_like(x), -np.ones_like(x)]), self.indentation - drop

    def over(self, nodes, aside):
        """The same on a surface that stands aside, at `nodes` by `aside`, shape (2, n), before it is loaded."""
        return RollAside(**vars(self), nodes=nodes, aside=aside)

    def slope(self, x):
        """dy/dx of the profile, by which a vertical pressure pushes along x; zero where it is normal to the circle."""
        if self.profile == "deformed":
            return np.zeros_like(x)
        return x / self.radius if self.profile == "parabola" else x / np.sqrt(self.radius**2 - x**2)


@dataclass(frozen=True, eq=False)
class RollAside(Roll):
    """The same on a surface that stands aside, at `nodes` [m] by `aside` [m], shape (2, n), before it is loaded."""

    nodes: np.ndarray
    aside: np.ndarray

    def touch(self, x, displacement):
        aside = self.aside @ interpolation(self.nodes, x).T
        normal, depth = super().touch(x, displacement + aside)
        return normal, depth - np.sum(normal * aside, axis=0)

    def over(self, nodes, aside):
        return replace(self, aside=self.aside + aside)


@dataclass(frozen=True, eq=False)
class Patch:
    """A contact patch: edges, pressure and traction at quadrature points, and what they do to the nodes.

    trailing, leading : lower and upper end of the patch in x [m]
    x, weight, pressure : points, their quadrature weights and pressure, shape (q,)
    direction, shear : traction over pressure there, and its tangential part, shape (2, q)
    forces : on the loaded nodes, shape (2, m);  displacement : of the surface nodes, shape (2, n)
    coefficients : of the pressure;  exponent : alpha of its edges
    slopes : how far the amplitudes of the singular pressures follow the edges, shape (2, 2)
    peaks : largest pressure, by `FEWER` terms less and by all
    history : (trailing, leading, step over length) of every iteration
    """

    trailing: float
    leading: float
    x: np.ndarray
    weight: np.ndarray
    pressure: np.ndarray
    direction: np.ndarray
    shear: np.ndarray
    forces: np.ndarray
    displacement: np.ndarray
    coefficients: np.ndarray
    exponent: float
    slopes: np.ndarray | None = None
    peaks: tuple = ()
    history: tuple = ()

    @property
    def edges(self):
        return self.trailing, self.leading

    @property
    def peak(self):
        """Largest pressure: both peaks scatter to opposite sides of it, tenfold as far as their mean."""
        return sum(self.peaks) / 2

    @property
    def scatter(self):
        """Half the difference of both peaks over their mean."""
        return abs(self.peaks[1] - self.peaks[0]) / sum(self.peaks)

    def integral(self, values):
        """int values dx over the patch."""
        return float(np.sum(self.weight * values))

    def sampled(self, count):
        """x and pressure at so many points, crowded at the edges, where the pressure is zero."""
        half = np.linspace(0, np.pi / 2, count)
        xi, rest = np.sin(half) ** 2, np.cos(half) ** 2
        inner = _functions(xi[1:-1], rest[1:-1], self.exponent, len(self.coefficients) - 2) @ self.coefficients
        x = self.trailing + (self.leading - self.trailing) * xi
        x[-1] = self.leading
        return x, np.concatenate([[0.0], inner, [0.0]])


def press(surface, roll, terms, start=None, edges=None):
    """The `Patch` under a roller, with up to so many terms for the pressure, one for three nodes at most.

    start : a patch near the one sought; without it the edges start from `edges`, (trailing, leading) in x [m], or from
        the active set of `touched`, first with few terms and then with more and more. UnresolvedError with the history
        if the edges do not settle, BeyondWindowError if they leave the loaded zone
    """
    history = []
    if start is not None:
        patch = _settled_from(start, surface, roll, len(start.coefficients) - 2, history)
    elif edges is None:
        patch = _pressed_between(touched(surface, roll), surface, roll, terms, history)
    else:
        try:
            patch = _pressed_between(np.array(edges), surface, roll, terms, history)
        except UnresolvedError:  # where the surface moves far along x the edges are not those of a surface at rest
            patch = _pressed_between(touched(surface, roll), surface, roll, terms, history)
    return replace(patch, history=tuple(history))


def _pressed_between(edges, surface, roll, terms, history):
    """The `Patch` from two edges on, first with few terms, then with more and more."""
    terms = min(terms, max(1, np.sum((edges[0] < surface.x) & (surface.x < edges[1])) // NODES_PER_TERM))
    few = min(terms, FIRST_TERMS)
    patch = _settled(surface, roll, few, edges, np.zeros((2, len(surface.x))), None, history)
    while MORE * few < terms:
        few = int(MORE * few)
        patch = _settled_from(patch, surface, roll, few, history)
    return _settled_from(patch, surface, roll, terms, history)


def _settled_from(start, surface, roll, terms, history):
    return _settled(surface, roll, terms, np.array(start.edges), start.displacement, start.slopes, history)


def with_peaks(surface, roll, patch):
    """The patch with its own peak pressure and that of a patch with `FEWER` terms."""
    terms, history = max(1, len(patch.coefficients) - 2 - FEWER), []
    fewer = _settled_from(patch, surface, roll, terms, history)
    peaks = tuple(float(each.sampled(PEAK_SAMPLES)[1].max()) for each in (fewer, patch))
    return replace(patch, peaks=peaks, history=patch.history + tuple(history))


def touched(surface, roll):
    """Guess of the two edges: pressure piecewise linear between corners, contact by the active set.

    Corners enter where the surface would stand inside the roller and leave where they would be pulled.
    """
    H = _hats(np.diff(surface.x[surface.first : surface.last : 2]))
    response = surface.response[1, surface.first : surface.last]
    A = H.T @ (response[:, 1] - roll.friction * response[:, 0]) @ H
    depth = H.T @ roll.touch(surface.x[surface.first : surface.last], 0.0)[1]
    active, seen = depth > 0, set()
    while active.any() and active.tobytes() not in seen:
        seen.add(active.tobytes())
        pressure = np.zeros(len(depth))
        pressure[active] = np.linalg.solve(A[np.ix_(active, active)], depth[active])
        active = np.where(active, pressure > 0, depth - A @ pressure > 0)
    if not active.any():
        raise UnresolvedError(
            f"no corner would carry pressure at a depth of {roll.indentation:.3g} m: the mesh is too coarse under the "
            f"contact, or the roller of radius {roll.radius:g} m is pressed in whole"
        )
    if active[0] or active[-1]:
        raise BeyondWindowError("the contact fills the loaded zone")
    corners = surface.x[surface.first : surface.last : 2]
    first, last = np.flatnonzero(active)[[0, -1]]
    return np.array([corners[first - 1 : first + 1].mean(), corners[last : last + 2].mean()])


def _hats(sizes):
    """Nodal forces, corners and middles, of pressures that are hats on the corners: shape (2 c - 1, c)."""
    H = np.zeros((2 * len(sizes) + 1, len(sizes) + 1))
    k = np.arange(len(sizes))
    H[2 * k, k] += sizes / 6
    H[2 * k + 1, k] = H[2 * k + 1, k + 1] = sizes / 3
    H[2 * k + 2, k + 1] += sizes / 6
    return H


def _settled(surface, roll, terms, edges, displacement, slopes, history):
    """Newton for the edges, its slopes updated by the secant rule of Broyden, and found anew where steps grow."""
    patch, amplitudes = _held(surface, roll, edges, displacement, terms)
    moved = np.inf
    for turn in range(ITERATIONS):
        if slopes is None:
            slopes = _slopes(surface, roll, edges, displacement, terms, amplitudes)
        before, step = moved, np.linalg.solve(slopes, -amplitudes)
        moved = (np.abs(step).max() / (edges[1] - edges[0])).item()
        change = np.abs(patch.displacement - displacement).max()
        steady = roll.profile != "deformed" or change <= EDGE_TOLERANCE * np.abs(patch.displacement).max()
        history.append((*edges.tolist(), moved))
        if moved < EDGE_TOLERANCE and steady:
            return replace(patch, slopes=slopes)
        step *= min(1.0, STEP / max(moved, STEP)) * (1.0 if turn < PATIENCE else 0.5)
        edges, displacement, known = edges + step, patch.displacement, amplitudes
        patch, amplitudes = _held(surface, roll, edges, displacement, terms)
        secant = slopes + np.outer(amplitudes - known - slopes @ step, step) / (step @ step)
        slopes = secant if moved < max(before, EDGE_TOLERANCE) else None
    if roll.profile == "circle" and np.abs(edges).max() > roll.radius:
        raise RuntimeError(beyond_circle(*edges, roll.radius))
    raise UnresolvedError(
        f"contact edges did not settle: (trailing, leading, step over length) were {history[-LAST:]} at last"
    )


def beyond_circle(trailing, leading, radius):
    """What to say of such edges."""
    contact = f"the contact, from {trailing:.3g} to {leading:.3g} m,"
    return f"{contact} is wider than the circle of radius {radius:g} m; press less"


def _slopes(surface, roll, edges, displacement, terms, amplitudes):
    """Derivatives of the two amplitudes by the two edges."""
    reach = 1e-4 * (edges[1] - edges[0])
    moved = [_held(surface, roll, edges + reach * side, displacement, terms)[1] for side in np.eye(2)]
    return (np.array(moved) - amplitudes).T / reach


def _held(surface, roll, edges, displacement, terms):
    """The patch between given edges, and the amplitudes of its singular pressures at them."""
    if edges[0] < surface.x[surface.first] or edges[1] > surface.x[surface.last - 1]:
        raise BeyondWindowError(f"contact edges {edges.tolist()} leave the loaded zone")
    if not edges[1] - edges[0] > NARROWEST * (surface.x[surface.last - 1] - surface.x[surface.first]):
        raise UnresolvedError(f"the contact between {edges.tolist()} is too narrow for the mesh")
    x, weight, xi, rest = quadrature(surface.x, edges)
    N = interpolation(surface.x, x)
    normal, depth = roll.touch(x, displacement @ N.T)
    shear = roll.friction * np.array([-normal[1], normal[0]])
    direction = normal + shear
    trial = _functions(xi, rest, roll.exponent, terms)
    test = _functions(xi, rest, 1 - roll.exponent, terms) * weight[:, None]  # those of the traction turned round
    loads = N[:, surface.first : surface.last].T
    forces = np.stack([loads @ (trial * (weight * part)[:, None]) for part in direction])
    moved = np.einsum("iakb,kbj->iaj", surface.response, forces, optimize=True)
    A = sum((test * normal[i][:, None]).T @ (N @ moved[i]) for i in range(2))
    try:
        coefficients = np.linalg.solve(A, test.T @ depth)
    except np.linalg.LinAlgError as singular:
        raise UnresolvedError(f"the mesh is too coarse under the contact: {terms} terms of pressure") from singular
    patch = Patch(
        *edges.tolist(),
        x=x,
        weight=weight,
        pressure=trial @ coefficients,
        direction=direction,
        shear=shear,
        forces=forces @ coefficients,
        displacement=moved @ coefficients,
        coefficients=coefficients,
        exponent=roll.exponent,
    )
    return patch, coefficients[-2:]


def _functions(xi, rest, exponent, terms):
    """Regular pressures by Chebyshev terms, then those singular at the trailing and at the leading edge."""
    angle = 2 * np.arcsin(np.sqrt(np.minimum(rest, 1.0)))
    base = xi**exponent * rest ** (1 - exponent)
    regular = base[:, None] * np.cos(angle[:, None] * np.arange(terms))
    return np.column_stack([regular, base / xi, base / rest])


def quadrature(nodes, edges):
    """Points, weights and the shares xi, 1 - xi of the length between the edges, broken at the corners.

    x = trailing + length sin^2(pi s/2),  s = t^3/(t^3 + (1 - t)^3): crowded at the edges.
    """
    trailing, leading = edges
    length = leading - trailing
    corners = nodes[::2]
    inner = (corners - trailing) / length
    breaks = np.concatenate([[0.0], inner[(inner > AT_EDGE) & (inner < 1 - AT_EDGE)], [1.0]])
    s = 2 / np.pi * np.arcsin(np.sqrt(breaks))
    with np.errstate(divide="ignore"):
        t = 1 / (1 + np.cbrt((1 - s) / np.maximum(s, 0)))
    g, w = GAUSS
    half = np.diff(t)[:, None] / 2
    t, dt = (t[:-1, None] + half * (1 + g)).ravel(), (half * w).ravel()
    low, high = t**EDGE_POWER, (1 - t) ** EDGE_POWER
    s, rest = low / (low + high), high / (low + high)
    ds = EDGE_POWER * (t * (1 - t)) ** (EDGE_POWER - 1) / (low + high) ** 2
    xi, other = np.sin(np.pi / 2 * s) ** 2, np.sin(np.pi / 2 * rest) ** 2
    weight = length * np.pi * np.sin(np.pi / 2 * s) * np.sin(np.pi / 2 * rest) * ds * dt
    return trailing + length * xi, weight, xi, other


def interpolation(nodes, x, derivative=False):
    """Quadratic interpolation, or its slope, from the nodes, corners and middles, to the points x: shape (q, n)."""
    corners = nodes[::2]
    element = np.clip(np.searchsorted(corners, x, side="right") - 1, 0, len(corners) - 2)
    size = corners[element + 1] - corners[element]
    z = (x - corners[element]) / size
    if derivative:
        values = (4 * z - 3) / size, (4 - 8 * z) / size, (4 * z - 1) / size
    else:
        values = (1 - z) * (1 - 2 * z), 4 * z * (1 - z), z * (2 * z - 1)
    N = np.zeros((len(x), len(nodes)))
    for place, value in enumerate(values):
        N[np.arange(len(x)), 2 * element + place] = value
    return N


def interpolated(nodes, values, x):
    """Quadratic interpolation of values at the nodes, shape (..., n), to the points x, shape (..., q)."""
    corners = nodes[::2]
    element = np.clip(np.searchsorted(corners, x, side="right") - 1, 0, len(corners) - 2)
    z = (x - corners[element]) / (corners[element + 1] - corners[element])
    shapes = (1 - z) * (1 - 2 * z), 4 * z * (1 - z), z * (2 * z - 1)
    return sum(values[..., 2 * element + place] * shape for place, shape in enumerate(shapes))
