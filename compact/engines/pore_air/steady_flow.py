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
flows along x: both rows of its grid have this pressure, and no air flows between them. Outside the contact the surface
is drained. The mean pressure of a parabola over the height leaks there by s = 3 K_yy/H^2. Columns do not move sideways,
so that air changes no height under the roller; it extends the contact behind by a length that is neglected.

References
----------
A. N. Brooks and T. J. R. Hughes, Comput. Methods Appl. Mech. Eng. 32 (1982) 199 (streamline upwinding); C. A. J.
Fletcher, Comput. Methods Appl. Mech. Eng. 37 (1983) 225 (group formulation).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.linalg import spsolve
from skfem import Basis, BilinearForm, ElementQuad1, MeshQuad
from skfem.helpers import dot, grad, mul
from threadpoolctl import threadpool_limits

from compact.engines.pore_air import AirForces
from compact.material.pore_air import PoreAir
from compact.numerics import Array, BoolArray
from compact.numerics.validation import require_positive
from compact.rolling_contact import Contact, Layer, Roller

if TYPE_CHECKING:
    import meshio

    from compact.engines.compaction.rolling import IncrementalRolling

RESIDUAL_TOLERANCE = 1e-10  # [-], residual of a node over the sum of its fluxes
MAX_ITERATIONS = 60  # [-], Newton iterations; 3 to 12 are usual
MIN_PRESSURE_SHARE = 0.2  # [-], least pressure after a step over that before
MAX_STEP_CUTS = 12  # [-], halvings of a step
SMALL_PECLET = 1e-3  # [-], element Peclet number below which coth Pe - 1/Pe is Pe/3
LARGE_PECLET = 1e9  # [-], bound of the element Peclet number where the mix is impermeable
GAUSS = 0.5 + np.array([-1.0, 1.0]) / np.sqrt(12)  # [-], points of order 3 on the unit interval
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
        Heights of the nodes [m], ascending.
    air_volume : ndarray, shape (n, m)
        Volume of the air over that of the fed mix a [-], > 0.
    mobility : ndarray, shape (2, 2, n, m)
        Permeability over viscosity in the fed configuration K [m2/(Pa s)].
    drained : ndarray of bool, shape (n, m)
        Nodes with the pressure of the surroundings, in addition to those ahead, where the mix enters.
    ambient_pressure : float
        Absolute pressure of the surroundings p0 [Pa].
    leakage : ndarray, shape (n, m)
        Leakage s to the surroundings [1/(Pa s)]; none by default.

    """

    x: Array
    y: Array
    air_volume: Array
    mobility: Array
    drained: BoolArray
    ambient_pressure: float
    leakage: Array | float = 0.0

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
        convection, diffusion = self.operators(speed)
        magnitudes, free = (abs(convection), abs(diffusion)), ~self.fixed
        volume, ambient = self.air_volume.ravel(), self.ambient_pressure

        def evaluate(excess: Array) -> tuple[Array, float]:
            """Return the fluxes of the nodes, and the largest on a free one over the sum of its parts."""
            p, potential = ambient + excess, excess * (excess + 2 * ambient) / 2  # (p^2 - p0^2)/2
            fluxes = convection @ (volume * p) + diffusion @ potential
            parts = magnitudes[0] @ (volume * p) + magnitudes[1] @ abs(potential)
            return fluxes, float((abs(fluxes) / parts)[free].max())

        excess = np.zeros(volume.size) if start is None else np.where(free, start.excess.ravel(), 0.0)
        fluxes, size = evaluate(excess)
        least = size
        with threadpool_limits(1):  # threads slow down systems of this size
            for iteration in range(MAX_ITERATIONS):
                if size <= RESIDUAL_TOLERANCE:
                    return AirPressure(self, speed, excess.reshape(self.air_volume.shape), iteration, fluxes)
                p, before, change = ambient + excess, size, np.zeros(volume.size)
                tangent = csr_array(convection.multiply(volume) + diffusion.multiply(p))
                change[free] = spsolve(tangent[free][:, free], -fluxes[free])
                for cuts in range(MAX_STEP_CUTS):
                    trial = np.maximum(excess + change / 2**cuts, MIN_PRESSURE_SHARE * p - ambient)
                    fluxes, size = evaluate(trial)
                    if size < before:
                        break
                excess, least = trial, min(least, size)
        raise RuntimeError(
            f"the pressure of the air at {speed:.4g} m/s did not converge: residual {least:.1e} of the fluxes "
            f"after {MAX_ITERATIONS} iterations, tolerance {RESIDUAL_TOLERANCE:.0e}; use a lower speed or a larger "
            "`air_permeability`"
        )

    @cached_property
    def fixed(self) -> BoolArray:
        """Drained nodes and those ahead, shape (n m,)."""
        fixed = self.drained.copy()
        fixed[-1] = True
        return fixed.ravel()

    @cached_property
    def basis(self) -> Basis:
        """Linear elements; Gauss points along x, nodes across it, so that the convection is lumped across.

        Node i, j of the grid has the number i m + j.
        """
        across, along = np.meshgrid([0.0, 1.0], GAUSS)  # the first direction of an element of `init_tensor` is y
        points = np.array([across.ravel(), along.ravel()])
        return Basis(MeshQuad.init_tensor(self.x, self.y), ElementQuad1(), quadrature=(points, np.full(4, 0.25)))

    @cached_property
    def diffusion(self) -> csr_array:
        """Matrix of the flow by p^2/2 [m2/(Pa s)], shape (n m, n m)."""
        tensor = np.array([[self.basis.interpolate(each.ravel()) for each in row] for row in self.mobility])
        return csr_array(BilinearForm(lambda u, w, _: dot(mul(tensor, grad(u)), grad(w))).assemble(self.basis))

    def operators(self, speed: float) -> tuple[csr_array, csr_array]:
        """Return the matrices of a p and of (p^2 - p0^2)/2 at a speed [m/s], shape (n m, n m), upwinded along x.

        The test functions of each element are shifted upstream by a delay. The residual of linear elements lacks the
        flow. The delay is therefore bounded by the times of diffusion in the element along x and y, so that its error
        is of second order.
        """

        def of_elements(axis: int) -> Array:  # diffusivity of the pressure [m2/s], mean over the nodes
            rate = self.mobility[axis, axis] * self.ambient_pressure / self.air_volume
            rows = (rate[:-1] + rate[1:]) / 2
            return (rows[:, :-1] + rows[:, 1:]) / 2

        lengths = np.diff(self.x)[:, None]
        peclet = speed * lengths / (2 * np.maximum(of_elements(0), np.finfo(float).tiny * speed))
        safe = np.clip(peclet, SMALL_PECLET, LARGE_PECLET)
        delay = lengths / (2 * speed) * np.where(peclet < SMALL_PECLET, peclet / 3, 1 / np.tanh(safe) - 1 / safe)
        delay = delay / np.hypot(1.0, delay * 12 * of_elements(1) / np.diff(self.y) ** 2)
        delay = delay.reshape(-1, 1)  # element i, j has the number i (m - 1) + j
        leakage = self.basis.interpolate(np.broadcast_to(self.leakage, self.air_volume.shape).ravel())
        convect = BilinearForm(lambda u, w, _: -speed * (w - speed * delay * grad(w)[0]) * grad(u)[0])
        leak = BilinearForm(lambda u, w, _: leakage * u * (w - speed * delay * grad(w)[0]))
        return csr_array(convect.assemble(self.basis)), self.diffusion + csr_array(leak.assemble(self.basis))


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
    def mass_residual(self) -> float:
        """Air that enters less that which leaves, over the former [-]; leakage of columns counts as a residual."""
        convected = np.asarray(self.speed * np.trapezoid(self.flow.air_volume * self.pressure, self.flow.y, axis=1))
        return float(1 - (convected[0] - self.fluxes[self.flow.fixed].sum()) / convected[-1])


class AirUnderContact:
    """Pore air in a contact, at any speed.

    Attributes
    ----------
    flow : AirFlow
        Flow of the air on its grid.
    contact : (float, float)
        Trailing and leading edge of the contact on the grid [m].
    surface : ndarray
        Positions of the surface of the grid [m], shape (2, n).
    on_roller : slice or ndarray of bool
        Nodes of the surface whose pressure acts on the roller; elsewhere it is that of the surroundings.
    """

    flow: AirFlow
    contact: tuple[float, float]
    surface: Array
    on_roller: slice | BoolArray = slice(None)

    def pressure(self, speed: float, start: AirPressure | None = None) -> AirPressure:
        """Solve for the pressure at a speed of the roller along x [m/s], not 0; `start` is one at another speed."""
        return self.flow.solve(abs(speed), start)

    def forces(self, pressure: AirPressure) -> AirForces:
        """Return load and resistance of the air on the roller, and its largest excess pressure behind the contact."""
        excess, (x, y) = pressure.excess[self.on_roller, -1], self.surface[:, self.on_roller]
        behind = max(float(pressure.excess[pressure.flow.x < self.contact[0]].max()), 0.0)
        return AirForces(float(np.trapezoid(excess, x)), float(np.trapezoid(excess, y)), behind)


class ColumnAir(AirUnderContact):
    """Pore air in the columns under a roller; nodes uniform along the contact with its edges, growing beyond.

    Parameters
    ----------
    air : PoreAir
        Pore air with its permeability.
    layer : Layer
        Layer as fed.
    roller : Roller
        Roller, whose profile "deformed" is the circle.
    contact : Contact
        Contact without air.
    """

    def __init__(self, air: PoreAir, layer: Layer, roller: Roller, contact: Contact) -> None:
        H, R, self.air = layer.height, roller.radius, air
        self.contact = trailing, leading = -abs(contact.trailing), abs(contact.leading)
        inner = np.linspace(trailing, leading, ELEMENTS + 1)
        step = inner[1] - inner[0]
        count = int(np.ceil(np.log1p(OUTER_LENGTH * H / step * (OUTER_GROWTH - 1)) / np.log(OUTER_GROWTH)))
        outer = np.cumsum(step * OUTER_GROWTH ** np.arange(1, count + 1))
        x = np.concatenate([inner[0] - outer[::-1], inner, inner[-1] + outer])
        inside = np.clip(x, trailing, leading)
        root = R if roller.profile == "parabola" else np.sqrt(np.maximum(R**2 - inside**2, 0.0))
        heights = H - contact.indentation + inside**2 / (R + root)
        heights = np.where(x > leading, H, np.where(x < trailing, contact.exit_height, heights))
        self.surface, self.on_roller = np.array([x, heights]), (x >= trailing) & (x <= leading)
        ratio = heights / H
        voids = air.bounded(ratio / air.fed_density_ratio - 1)
        mobility = np.zeros((2, 2, len(x), 2))
        mobility[0, 0] = (air.mobility(voids) * ratio)[:, None]
        leakage = DRAINAGE / H**2 * air.mobility(voids) / ratio * ~self.on_roller
        volume, leakage = (np.repeat(each[:, None], 2, axis=1) for each in (air.fed_density_ratio * voids, leakage))
        drained = np.zeros_like(volume, dtype=bool)
        self.flow = AirFlow(x, np.array([0.0, H]), volume, mobility, drained, air.ambient_pressure, leakage)


class RollerAir(AirUnderContact):
    """Pore air in the deformed layer under a roller in steady motion.

    It flows in the fed configuration, through which the mix moves straight along -x.

    Parameters
    ----------
    rolling : IncrementalRolling
        Steady solution of the skeleton.
    air : PoreAir
        Pore air with its permeability.
    """

    def __init__(self, rolling: "IncrementalRolling", air: PoreAir) -> None:
        self.rolling, self.air, frame = rolling, air, rolling.frame
        fed, positions = frame.nodes[frame.surface_nodes], rolling.surface_positions
        touching = np.flatnonzero(rolling.contact.pressure > 0)
        trailing, leading = ((fed[i - 1, 0] + fed[i, 0]) / 2 for i in (touching[0], touching[-1] + 1))
        self.contact = float(trailing), float(leading)
        xx, xy, yx, yy = (frame.solid.displacement_gradient(rolling.state.displacement) + np.array([1.0, 0, 0, 1.0])).T
        volume_ratio = xx * yy - xy * yx
        density_ratio = np.broadcast_to(frame.fed_layer.stacked.points.density_ratio[:, None], frame.to_rows(xx).shape)
        voids = air.bounded(frame.to_rows(volume_ratio) / density_ratio - 1)
        # J C^-1 with C = F'F, the permeability of the fed configuration over that of the mix
        tensor = np.array([[xy * xy + yy * yy, -xx * xy - yx * yy], [-xx * xy - yx * yy, xx * xx + yx * yx]])
        tensor /= volume_ratio
        mobility = np.array([[frame.to_rows(each) for each in row] for row in tensor]) * air.mobility(voids)
        x = np.concatenate([frame.mesh.x[-1, :1], frame.row_x, frame.mesh.x[-1, -1:]])
        y = np.concatenate([frame.mesh.y[:1], frame.row_y, frame.mesh.y[-1:]])
        drained = np.zeros((len(x), len(y)), dtype=bool)
        drained[:, -1] = (x < trailing) | (x > leading)
        self.flow = AirFlow(x, y, _on_grid(density_ratio * voids), _on_grid(mobility), drained, air.ambient_pressure)
        # the gap is measured at x of the fed mix unless it is that of the deformed surface
        moved = positions if rolling.surface.profile == "deformed" else fed
        self.surface = np.array([np.interp(x, fed[:, 0], moved[:, 0]), np.interp(x, fed[:, 0], positions[:, 1])])

    def at_points(self, pressure: AirPressure) -> Array:
        """Return the excess pressure at the Gauss points of the engine [Pa], shape (n,)."""
        return self.rolling.frame.to_points(pressure.excess[1:-1, 1:-1].T)

    def add_field(self, mesh: "meshio.Mesh", pressure: AirPressure) -> None:
        """Add the excess pressure [Pa] to a mesh of `compaction.results.field_mesh`, means over the elements."""
        elements = sum(len(block.data) for block in mesh.cells)
        mesh.cell_data["air_pressure"] = [self.at_points(pressure).reshape(elements, -1).mean(axis=1)]


def _on_grid(rows: Array) -> Array:
    """Values by rows, shape (..., rows, columns), on the nodes of the grid, shape (..., columns + 2, rows + 2)."""
    width = [(0, 0)] * (rows.ndim - 2) + [(1, 1), (1, 1)]
    return np.pad(np.swapaxes(rows, -1, -2), width, mode="edge")
