"""Pore air under a roller on confined columns: its pressure, averaged over the height, load and resistance.

The height of a column is that of the gap under the roller, h(x) = h_min + gap(x). Ahead of the contact it is the height
as fed, behind it the exit height. No air leaves through roller and base, so that the mean pressure of the height
flows along x. Outside the contact the surface is drained. The mean pressure of a parabola over the height leaks there
by s = 3 K_yy/H^2. Load and resistance at the height of the contact without air are

    load = int (p - p0) dx,    resistance = int (p - p0) dh

Columns do not move sideways, so that air changes no height under the roller; it extends the contact behind by a length
that is neglected.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from compact.engines.pore_air.steady_flow import AirFlow, AirPressure
from compact.material.pore_air import PoreAir
from compact.numerics import Array
from compact.rolling_contact import GapGeometry

ELEMENTS = 480  # [-], along the contact; the load changes by 3e-3 at most from 240
OUTER_LENGTH = 6.0  # [-], length ahead and behind over the height as fed
OUTER_GROWTH = 1.06  # [-], ratio of neighbouring elements there
DRAINAGE = 3.0  # [-], leakage of a parabola with one drained end: (dp/dy)/(mean p) times the height


@dataclass(frozen=True, eq=False)
class ColumnAir:
    """Pore air in the columns under a roller, at any speed.

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

    def pressure(self, speed: float, start: AirPressure | None = None) -> AirPressure:
        """Solve for the mean pressure of the height at a speed of the roller along x [m/s], not 0.

        Parameters
        ----------
        start : AirPressure, optional
            Pressure at another speed as initial guess.

        Returns
        -------
        AirPressure
        """
        return self.flow.solve(abs(speed), start)

    @cached_property
    def flow(self) -> AirFlow:
        """Flow of the air along the columns."""
        x = self._positions()
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
        x = pressure.flow.x
        inside = (x >= self.trailing) & (x <= self.leading)
        excess, x = pressure.excess[inside, 0], x[inside]
        return float(np.trapezoid(excess, x)), float(np.trapezoid(excess, self.heights(x)))

    def largest_excess_behind(self, pressure: AirPressure) -> float:
        """Return the largest mean excess pressure behind the contact [Pa], a tensile stress of the skeleton.

        Parameters
        ----------
        pressure : AirPressure
            Pressure of the air.

        Returns
        -------
        float
            Excess pressure [Pa]; 0 if there is none.
        """
        return max(float(pressure.excess[pressure.flow.x < self.trailing].max()), 0.0)

    def _positions(self) -> Array:
        """Nodes: uniform along the contact with its edges, growing elements beyond."""
        inner = np.linspace(self.trailing, self.leading, ELEMENTS + 1)
        step = inner[1] - inner[0]
        count = int(np.ceil(np.log1p(OUTER_LENGTH * self.height / step * (OUTER_GROWTH - 1)) / np.log(OUTER_GROWTH)))
        outer = np.cumsum(step * OUTER_GROWTH ** np.arange(1, count + 1))
        return np.concatenate([inner[0] - outer[::-1], inner, inner[-1] + outer])
