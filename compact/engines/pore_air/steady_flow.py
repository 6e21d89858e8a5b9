"""Steady pressure of pore air in the frame of the roller, by scikit-fem's forms.

    -v d(a p)/dx = div(K grad p^2/2) - s (p^2 - p0^2)/2

a is the volume of the air over that of the fed mix, and p the absolute pressure. K is the tensor permeability over
viscosity in the fed configuration, through which the mix moves by -v. The leakage s is that of a column through its
surface. The pressure is p0 on drained nodes. There is no flow through other boundaries, and at the rear end the air
leaves with the mix. The pressure depends on v/K alone.

The fluxes are interpolated from their values at the nodes (group formulation): a p is linear in each element, and so is
p^2/2. The operators are thus constant, and a p remains constant along x without drainage (Boyle's law at every node).
The streamline-upwind Petrov-Galerkin method stabilises the convection along x. Across x the convection is lumped, so
that thin drained layers along the surface do not oscillate. Both are of second order. Newton's method solves for p; its
steps are cut where they would leave p > 0 or raise the residual.

**Under a roller.** The total stress is the effective stress less the excess pressure p - p0, so that on the roller, at
a constant deformation,

    load = int (p - p0) dx,    resistance = int (p - p0) dy    along the contact

Load and resistance of the skeleton are those of the contact without air. `RollerAir` has the deformed layer of the
engine "compaction"; the grid are its Gauss points, which know deformation and density, and the lines of its boundary.

`ColumnAir` has the heights of confined columns: of the gap under the roller, h(x) = h_min + gap(x), as fed ahead of the
contact, and the exit height behind it. No air leaves through roller and base, so that the mean pressure of the height
flows along x. Outside the contact the surface is drained. The mean pressure of a parabola over the height leaks there
by s = 3 K_yy/H^2. Columns do not move sideways, so that air changes no height under the roller; it extends the contact
behind by a length that is neglected.

References
----------
A. N. Brooks and T. J. R. Hughes, Comput. Methods Appl. Mech. Eng. 32 (1982) 199 (streamline upwinding); C. A. J.
Fletcher, Comput. Methods Appl. Mech. Eng. 37 (1983) 225 (group formulation).
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.linalg import solve_banded
from scipy.sparse import csr_array
from skfem import Basis, BilinearForm, ElementLineP1, ElementQuad1, Mesh, MeshLine, MeshQuad
from skfem.helpers import dot, grad, mul
from threadpoolctl import threadpool_limits

from compact.material.pore_air import PoreAir
from compact.numerics import Array, BoolArray
from compact.numerics.validation import require_finite, require_nonnegative, require_positive
from compact.rolling_contact import GapGeometry

if TYPE_CHECKING:
    from compact.engines.compaction.incremental_rolling import IncrementalRolling

RESIDUAL_TOLERANCE = 1e-10  # [-], residual of a node over the sum of its fluxes
MAX_ITERATIONS = 60  # [-], Newton iterations; 3 to 12 are usual
MIN_PRESSURE_SHARE = 0.2  # [-], least pressure after a step over that before
MAX_STEP_CUTS = 12  # [-], halvings of a step
SMALL_PECLET = 1e-3  # [-], element Peclet number below which coth Pe - 1/Pe is Pe/3
LARGE_PECLET = 1e9  # [-], bound of the element Peclet number where the mix is impermeable
GAUSS = 0.5 + np.array([-1.0, 1.0]) / np.sqrt(12)  # [-], points of order 3 on the unit interval
WEIGHTS = np.full(2, 0.5)  # [-], of the two points of Gauss, and of the two ends of an interval
ELEMENTS = 480  # [-], along the contact of columns; the load changes by 3e-3 at most from 240
OUTER_LENGTH = 6.0  # [-], length ahead and behind over the height as fed
OUTER_GROWTH = 1.06  # [-], ratio of neighbouring elements there
DRAINAGE = 3.0  # [-], leakage of a parabola with one drained end: (dp/dy)/(mean p) times the height


@dataclass(frozen=True, eq=False)
class AirFlow:
    """Flow of pore air through fed mix that moves towards -x, on a grid of the fed configuration.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Positions of the nodes along the travel [m], ascending.
    y : ndarray, shape (m,)
        Heights of the nodes [m], ascending; one height for columns with the mean pressure of the height.
    air_volume : ndarray, shape (n, m)
        Volume of the air over that of the fed mix a [-], > 0.
    mobility : ndarray, shape (2, 2, n, m)
        Permeability over viscosity in the fed configuration K [m2/(Pa s)]; of columns K_xx is used.
    drained : ndarray of bool, shape (n, m)
        Nodes with the pressure of the surroundings, in addition to those ahead, where the mix enters.
    ambient_pressure : float
        Absolute pressure of the surroundings p0 [Pa].
    leakage : ndarray, shape (n, m), optional
        Leakage s to the surroundings [1/(Pa s)]; none by default.

    Raises
    ------
    ValueError
        If an array is out of its range.
    """

    x: Array
    y: Array
    air_volume: Array
    mobility: Array
    drained: BoolArray
    ambient_pressure: float
    leakage: Array | None = None

    def __post_init__(self) -> None:
        require_positive(air_volume=self.air_volume, ambient_pressure=self.ambient_pressure)
        require_finite(mobility=self.mobility)
        if self.leakage is not None:
            require_nonnegative(leakage=self.leakage)

    def solve(self, speed: float, start: "AirPressure | None" = None) -> "AirPressure":
        """Solve for the pressure at a speed of the roller.

        Parameters
        ----------
        speed : float
            Speed [m/s], > 0.
        start : AirPressure, optional
            Initial guess, such as the pressure at another speed; by default the pressure of the surroundings.

        Returns
        -------
        AirPressure

        Raises
        ------
        RuntimeError
            If Newton's method does not converge.
        """
        require_positive(speed=speed)
        operators = _Operators(self, speed)
        excess = np.zeros(self.air_volume.size) if start is None else start.excess.ravel()
        trial, sizes = operators.evaluate(np.where(operators.fixed, 0.0, excess)), []
        with threadpool_limits(1):  # threads slow down systems of this size
            for iteration in range(MAX_ITERATIONS):
                sizes.append(trial.size)
                if trial.size <= RESIDUAL_TOLERANCE:
                    found = trial.excess.reshape(self.air_volume.shape)
                    return AirPressure(self, speed, found, iteration, trial.fluxes)
                trial = operators.step(trial)
        raise RuntimeError(
            f"the pressure of the air at {speed:.4g} m/s did not converge: residual {min(sizes):.1e} of the fluxes "
            f"after {MAX_ITERATIONS} iterations, tolerance {RESIDUAL_TOLERANCE:.0e}; use a lower speed or a larger "
            "`air_permeability`"
        )

    @cached_property
    def basis(self) -> Basis:
        """Linear elements; Gauss points along x, nodes across it, so that the convection is lumped across."""
        if len(self.y) == 1:
            return Basis(MeshLine(self.x), ElementLineP1(), quadrature=(GAUSS[None], WEIGHTS))
        across, along = np.meshgrid([0.0, 1.0], GAUSS)  # the first direction of an element of `init_tensor` is y
        points = np.array([across.ravel(), along.ravel()])
        return Basis(self.mesh, ElementQuad1(), quadrature=(points, np.outer(WEIGHTS, WEIGHTS).ravel()))

    @cached_property
    def mesh(self) -> Mesh:
        """Mesh of the grid; node i, j has the number i m + j."""
        return MeshLine(self.x) if len(self.y) == 1 else MeshQuad.init_tensor(self.x, self.y)

    @cached_property
    def fixed(self) -> BoolArray:
        """Drained nodes and those ahead, shape (n m,)."""
        fixed = self.drained.copy()
        fixed[-1] = True
        return fixed.ravel()

    @cached_property
    def diffusion(self) -> csr_array:
        """Matrix of the flow by p^2/2 [m2/(Pa s)], shape (n m, n m)."""
        dimension = self.mesh.dim()
        tensor = np.array([
            [self.basis.interpolate(self.mobility[i, j].ravel()) for j in range(dimension)] for i in range(dimension)
        ])  # fmt: skip

        @BilinearForm
        def flow(u: Any, w: Any, _: Any) -> Any:
            return dot(mul(tensor, grad(u)), grad(w))

        return csr_array(flow.assemble(self.basis))

    def operators(self, speed: float) -> tuple[csr_array, csr_array]:
        """Return the matrices of a p and of (p^2 - p0^2)/2 at a speed [m/s], shape (n m, n m), upwinded along x."""
        delay, diffusion = self._delays(speed), self.diffusion

        @BilinearForm
        def convect(m: Any, w: Any, _: Any) -> Any:
            return -speed * (w - speed * delay * grad(w)[0]) * grad(m)[0]

        if self.leakage is not None:
            rate = self.basis.interpolate(self.leakage.ravel())

            @BilinearForm
            def leak(u: Any, w: Any, _: Any) -> Any:
                return rate * u * (w - speed * delay * grad(w)[0])

            diffusion = diffusion + csr_array(leak.assemble(self.basis))
        return csr_array(convect.assemble(self.basis)), diffusion

    def _delays(self, speed: float) -> Array:
        """Return the time by which the test functions of each element are shifted upstream [s], shape (elements, 1).

        The residual of linear elements lacks the flow. The shift is therefore bounded by the times of diffusion in the
        element along x and y, so that its error is of second order.
        """
        rates = [self.mobility[i, i] * self.ambient_pressure / self.air_volume for i in range(self.mesh.dim())]
        along, *across = (_element_means(rate) for rate in rates)  # diffusivities of the pressure [m2/s]
        lengths, heights = np.diff(self.x)[:, None], np.diff(self.y)
        diffusion = np.maximum(along, np.finfo(float).tiny * speed)
        peclet = np.minimum(speed * lengths / (2 * diffusion), LARGE_PECLET)
        safe = np.maximum(peclet, SMALL_PECLET)
        share = np.where(peclet < SMALL_PECLET, peclet / 3, 1 / np.tanh(safe) - 1 / safe)
        times = lengths / (2 * speed) * share
        for rate in across:
            times = times / np.hypot(1.0, times * 12 * rate / heights**2)
        return times.reshape(-1, 1)  # element i, j has the number i (m - 1) + j


def _element_means(values: Array) -> Array:
    """Return the means of nodal values over the elements of a grid, of columns over their elements along x."""
    means = (values[:-1] + values[1:]) / 2
    return means if means.shape[1] == 1 else (means[:, :-1] + means[:, 1:]) / 2


@dataclass(frozen=True, eq=False)
class AirPressure:
    """Pressure of the air at one speed.

    Parameters
    ----------
    flow : AirFlow
        Flow of which it is the solution.
    speed : float
        Speed of the roller [m/s].
    excess : ndarray, shape (n, m)
        Pressure above that of the surroundings at the nodes [Pa].
    iterations : int
        Newton iterations.
    fluxes : ndarray, shape (n m,)
        Air that enters at the nodes, pressure times volume per time [Pa m2/s]; 0 but for drained nodes.
    """

    flow: AirFlow
    speed: float
    excess: Array
    iterations: int
    fluxes: Array

    @property
    def pressure(self) -> Array:
        """Absolute pressure [Pa], shape (n, m)."""
        return self.flow.ambient_pressure + self.excess

    @property
    def inflow(self) -> float:
        """Air that enters with the fed mix, pressure times volume per time [Pa m2/s]; of columns [Pa m/s]."""
        return self._convected(-1)

    @property
    def drained(self) -> float:
        """Air that leaves through drained nodes, pressure times volume per time, as `inflow`."""
        return float(-self.fluxes[self.flow.fixed].sum())

    @property
    def mass_residual(self) -> float:
        """Air that enters less that which leaves, over the former [-]; leakage of columns counts as a residual."""
        return (self.inflow - self._convected(0) - self.drained) / self.inflow

    def _convected(self, column: int) -> float:
        air = self.flow.air_volume[column] * self.pressure[column]
        height = np.trapezoid(air, self.flow.y) if len(self.flow.y) > 1 else air[0]
        return float(self.speed * height)


@dataclass(frozen=True, eq=False)
class _Trial:
    """Excess pressure with the fluxes of the nodes, and the largest residual over the sum of the fluxes."""

    excess: Array
    fluxes: Array
    size: float


class _Operators:
    """Discrete equation at one speed: convection @ (a p) + diffusion @ (p^2 - p0^2)/2 = 0 on free nodes."""

    def __init__(self, flow: AirFlow, speed: float) -> None:
        self.volume, self.ambient = flow.air_volume.ravel(), flow.ambient_pressure
        self.fixed, self.width = flow.fixed, len(flow.y) + 1
        self.convection, self.diffusion = flow.operators(speed)
        self.magnitudes = abs(self.convection), abs(self.diffusion)
        self.bands = tuple(_band(matrix, self.width) for matrix in (self.convection, self.diffusion))

    def evaluate(self, excess: Array) -> _Trial:
        """Evaluate the fluxes of an excess pressure."""
        p = self.ambient + excess
        potential = excess * (p + self.ambient) / 2  # (p^2 - p0^2)/2
        fluxes = self.convection @ (self.volume * p) + self.diffusion @ potential
        scale = self.magnitudes[0] @ (self.volume * p) + self.magnitudes[1] @ abs(potential)
        return _Trial(excess, fluxes, float(np.where(self.fixed, 0.0, abs(fluxes) / scale).max()))

    def step(self, trial: _Trial) -> _Trial:
        """Return the trial after a step of Newton's method."""
        p = self.ambient + trial.excess
        band = self.bands[0] * self.volume + self.bands[1] * p
        column = np.arange(len(p))
        for offset in range(-self.width, self.width + 1):  # rows of fixed nodes
            row = column + offset
            inside = (row >= 0) & (row < len(column))
            inside[inside] = self.fixed[row[inside]]
            band[self.width + offset, inside] = float(offset == 0)
        change = solve_banded((self.width, self.width), band, np.where(self.fixed, 0.0, -trial.fluxes))
        length = 1.0
        for _ in range(MAX_STEP_CUTS):
            lowest = MIN_PRESSURE_SHARE * p - self.ambient
            candidate = self.evaluate(np.maximum(trial.excess + length * change, lowest))
            if candidate.size < trial.size:
                break
            length /= 2
        return candidate


def _band(matrix: csr_array, width: int) -> Array:
    """Return the diagonals of a matrix as rows, as `solve_banded` requires."""
    entries = matrix.tocoo()
    band = np.zeros((2 * width + 1, matrix.shape[0]))
    np.add.at(band, (width + entries.row - entries.col, entries.col), entries.data)
    return band


class AirUnderContact(ABC):
    """Pore air in a contact, at any speed."""

    @property
    @abstractmethod
    def flow(self) -> AirFlow:
        """Flow of the air on its grid."""

    @property
    @abstractmethod
    def contact(self) -> tuple[float, float]:
        """Trailing and leading edge of the contact on the grid [m]."""

    @property
    @abstractmethod
    def surface(self) -> Array:
        """Positions of the surface of the grid [m], shape (2, n)."""

    @property
    def on_roller(self) -> slice | BoolArray:
        """Nodes of the surface whose pressure acts on the roller; elsewhere it is that of the surroundings."""
        return slice(None)

    def pressure(self, speed: float, start: AirPressure | None = None) -> AirPressure:
        """Solve for the pressure of the air, of columns for its mean over the height.

        Parameters
        ----------
        speed : float
            Speed of the roller along x [m/s], not 0.
        start : AirPressure, optional
            Pressure at another speed as initial guess.

        Returns
        -------
        AirPressure
        """
        return self.flow.solve(abs(speed), start)

    def forces(self, pressure: AirPressure) -> tuple[float, float]:
        """Return load and resistance of the air on the roller [N/m].

        Parameters
        ----------
        pressure : AirPressure
            Pressure of the air.

        Returns
        -------
        load, resistance : float
            Forces per unit length of the roller [N/m].
        """
        excess, (x, y) = pressure.excess[self.on_roller, -1], self.surface[:, self.on_roller]
        return float(np.trapezoid(excess, x)), float(np.trapezoid(excess, y))

    def largest_excess_behind(self, pressure: AirPressure) -> float:
        """Return the largest excess pressure behind the contact [Pa].

        The total stress on horizontal planes vanishes there, so that it is a tensile stress of the skeleton.

        Parameters
        ----------
        pressure : AirPressure
            Pressure of the air.

        Returns
        -------
        float
            Excess pressure [Pa]; 0 if there is none.
        """
        return max(float(pressure.excess[pressure.flow.x < self.contact[0]].max()), 0.0)


@dataclass(frozen=True, eq=False)
class ColumnAir(AirUnderContact):
    """Pore air in the columns under a roller.

    Parameters
    ----------
    air : PoreAir
        Pore air with its permeability.
    height, exit_height, indentation : float
        Height of the layer as fed and behind the roller, depth of the lowest generatrix [m].
    leading, trailing : float
        Edges of the contact, positive ahead [m].
    radius : float
        Radius of the roller [m].
    profile : {"parabola", "circle", "deformed"}
        Geometry of the gap; "deformed" is the circle.
    """

    air: PoreAir
    height: float
    exit_height: float
    indentation: float
    leading: float
    trailing: float
    radius: float
    profile: GapGeometry = "circle"

    @cached_property
    def flow(self) -> AirFlow:
        """Flow of the air along the columns; nodes uniform along the contact with its edges, growing beyond."""
        inner = np.linspace(self.trailing, self.leading, ELEMENTS + 1)
        step = inner[1] - inner[0]
        count = int(np.ceil(np.log1p(OUTER_LENGTH * self.height / step * (OUTER_GROWTH - 1)) / np.log(OUTER_GROWTH)))
        outer = np.cumsum(step * OUTER_GROWTH ** np.arange(1, count + 1))
        x = np.concatenate([inner[0] - outer[::-1], inner, inner[-1] + outer])
        ratio = self.heights(x) / self.height
        fed = self.air.fed_density_ratio
        voids = self.air.bounded(ratio / fed - 1)
        mobility = np.zeros((2, 2, len(x), 1))
        mobility[0, 0, :, 0] = self.air.mobility(voids) * ratio
        mobility[1, 1, :, 0] = self.air.mobility(voids) / ratio
        outside = (x < self.trailing) | (x > self.leading)
        return AirFlow(
            x=x,
            y=np.zeros(1),
            air_volume=(fed * voids)[:, None],
            mobility=mobility,
            drained=np.zeros((len(x), 1), dtype=bool),
            ambient_pressure=self.air.ambient_pressure,
            leakage=DRAINAGE / self.height**2 * mobility[1, 1] * outside[:, None],
        )

    @property
    def contact(self) -> tuple[float, float]:
        """Trailing and leading edge of the contact [m]."""
        return self.trailing, self.leading

    @property
    def surface(self) -> Array:
        """Positions of the surface [m], shape (2, n)."""
        return np.array([self.flow.x, self.heights(self.flow.x)])

    @property
    def on_roller(self) -> BoolArray:
        """Nodes between the edges; the mean pressure of the height does not vanish beyond."""
        return (self.flow.x >= self.trailing) & (self.flow.x <= self.leading)

    def heights(self, x: Array) -> Array:
        """Compute the heights of the columns.

        Parameters
        ----------
        x : ndarray
            Positions from the lowest generatrix [m], ascending in the direction of the travel.

        Returns
        -------
        ndarray
            Heights [m].
        """
        inside = np.clip(x, self.trailing, self.leading)
        if self.profile == "parabola":
            gap = inside**2 / (2 * self.radius)
        else:
            gap = inside**2 / (self.radius + np.sqrt(np.maximum(self.radius**2 - inside**2, 0.0)))
        heights = self.height - self.indentation + gap
        return np.where(x > self.leading, self.height, np.where(x < self.trailing, self.exit_height, heights))


@dataclass(frozen=True, eq=False)
class RollerAir(AirUnderContact):
    """Pore air in the deformed layer under a roller in steady motion.

    Parameters
    ----------
    rolling : IncrementalRolling
        Steady solution of the skeleton.
    air : PoreAir
        Pore air with its permeability.
    """

    rolling: "IncrementalRolling"
    air: PoreAir

    @cached_property
    def flow(self) -> AirFlow:
        """Flow of the air on the grid, in the fed configuration, through which the mix moves straight along -x."""
        frame = self.rolling.frame
        gradient = frame.solid.displacement_gradient(self.rolling.state.displacement)
        xx, xy, yx, yy = (gradient + np.array([1.0, 0, 0, 1.0])).T
        volume_ratio = xx * yy - xy * yx
        density_ratio = np.broadcast_to(frame.fed_layer.stacked.points.density_ratio[:, None], frame.to_rows(xx).shape)
        voids = self.air.bounded(frame.to_rows(volume_ratio) / density_ratio - 1)
        # J C^-1 with C = F'F, the permeability of the fed configuration over that of the mix
        tensor = np.array([[xy * xy + yy * yy, -xx * xy - yx * yy], [-xx * xy - yx * yy, xx * xx + yx * yx]])
        tensor /= volume_ratio
        mobility = np.array([[frame.to_rows(each) for each in row] for row in tensor]) * self.air.mobility(voids)
        first, last = frame.mesh.x[-1, [0, -1]]
        bottom, top = frame.mesh.y[[0, -1]]
        x, y = np.concatenate([[first], frame.row_x, [last]]), np.concatenate([[bottom], frame.row_y, [top]])
        drained = np.zeros((len(x), len(y)), dtype=bool)
        drained[:, -1] = (x < self.contact[0]) | (x > self.contact[1])
        return AirFlow(x, y, _on_grid(density_ratio * voids), _on_grid(mobility), drained, self.air.ambient_pressure)

    @cached_property
    def surface(self) -> Array:
        """Positions of the surface of the grid [m], shape (2, n); x of the fed mix if the gap is measured there."""
        rolling, x = self.rolling, self.flow.x
        fed = rolling.frame.nodes[rolling.frame.surface_nodes]
        moved = rolling.surface_positions if rolling.surface.profile == "deformed" else fed
        return np.array(
            [np.interp(x, fed[:, 0], moved[:, 0]), np.interp(x, fed[:, 0], rolling.surface_positions[:, 1])]
        )

    @cached_property
    def contact(self) -> tuple[float, float]:
        """Trailing and leading edge of the contact in the fed configuration [m]."""
        frame = self.rolling.frame
        x = frame.nodes[frame.surface_nodes, 0]
        touching = np.flatnonzero(self.rolling.contact.pressure > 0)
        first, last = touching[0], touching[-1]
        return float((x[first - 1] + x[first]) / 2), float((x[last] + x[last + 1]) / 2)

    def at_points(self, pressure: AirPressure) -> Array:
        """Return the excess pressure at the Gauss points of the engine [Pa].

        Parameters
        ----------
        pressure : AirPressure
            Pressure of the air.

        Returns
        -------
        ndarray, shape (n,)
            Excess pressure [Pa].
        """
        return self.rolling.frame.to_points(pressure.excess[1:-1, 1:-1].T)


def _on_grid(rows: Array) -> Array:
    """Values by rows, shape (..., rows, columns), on the nodes of the grid, shape (..., columns + 2, rows + 2)."""
    width = [(0, 0)] * (rows.ndim - 2) + [(1, 1), (1, 1)]
    return np.pad(np.swapaxes(rows, -1, -2), width, mode="edge")
