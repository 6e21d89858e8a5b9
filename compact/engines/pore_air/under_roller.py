"""Pore air under a roller on compacting mix by finite elements: the grid of its pressure, load and resistance.

The nodes of the grid are the Gauss points of the engine's mesh, which carry deformation and density, and the lines of
its boundary. The pressure is solved in the fed configuration, through which the mix moves straight along -x. The
total stress is the effective stress less the excess pressure p - p0, so that on the roller, at a constant deformation,

    load = int (p - p0) dx,    resistance = int (p - p0) dy    along the contact

Load and resistance of the skeleton are those of the contact without air.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from compact.engines.compaction.incremental_rolling import IncrementalRolling
from compact.engines.pore_air.steady_flow import AirFlow, AirPressure
from compact.material.pore_air import PoreAir
from compact.numerics import Array


@dataclass(frozen=True, eq=False)
class RollerAir:
    """Pore air in the deformed layer under a roller in steady motion, at any speed.

    Parameters
    ----------
    rolling : IncrementalRolling
        Steady solution of the skeleton.
    air : PoreAir
        Pore air with its permeability.
    """

    rolling: IncrementalRolling
    air: PoreAir

    def pressure(self, speed: float, start: AirPressure | None = None) -> AirPressure:
        """Solve for the pressure of the air.

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

    @cached_property
    def flow(self) -> AirFlow:
        """Flow of the air on the grid."""
        rolling = self.rolling
        frame = rolling.frame
        gradient = frame.solid.displacement_gradient(rolling.state.displacement)
        xx, xy, yx, yy = (gradient + np.array([1.0, 0, 0, 1.0])).T
        volume_ratio = xx * yy - xy * yx
        density_ratio = np.broadcast_to(frame.fed_layer.stacked.points.density_ratio[:, None], frame.to_rows(xx).shape)
        voids = self.air.bounded(frame.to_rows(volume_ratio) / density_ratio - 1)
        # J C^-1 with C = F'F, the permeability of the fed configuration over that of the mix
        tensor = np.array([[xy * xy + yy * yy, -xx * xy - yx * yy], [-xx * xy - yx * yy, xx * xx + yx * yx]])
        tensor /= volume_ratio
        mobility = np.array([[frame.to_rows(each) for each in row] for row in tensor]) * self.air.mobility(voids)
        return AirFlow(
            x=self._padded(frame.row_x, *frame.mesh.x[-1, [0, -1]]),
            y=self._padded(frame.row_y, *frame.mesh.y[[0, -1]]),
            air_volume=_on_grid(density_ratio * voids),
            mobility=_on_grid(mobility),
            drained=self._drained_surface(),
            ambient_pressure=self.air.ambient_pressure,
        )

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
        excess = pressure.excess[:, -1]
        x, y = self.surface
        return float(np.trapezoid(excess, x)), float(np.trapezoid(excess, y))

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

    def _drained_surface(self) -> np.ndarray:
        frame = self.rolling.frame
        x = self._padded(frame.row_x, *frame.mesh.x[-1, [0, -1]])
        trailing, leading = self.contact
        drained = np.zeros((len(x), len(frame.row_y) + 2), dtype=bool)
        drained[:, -1] = (x < trailing) | (x > leading)
        return drained

    @staticmethod
    def _padded(values: Array, first: float, last: float) -> Array:
        return np.concatenate([[first], values, [last]])


def _on_grid(rows: Array) -> Array:
    """Values by rows, shape (..., rows, columns), on the nodes of the grid, shape (..., columns + 2, rows + 2)."""
    width = [(0, 0)] * (rows.ndim - 2) + [(1, 1), (1, 1)]
    return np.pad(np.swapaxes(rows, -1, -2), width, mode="edge")
