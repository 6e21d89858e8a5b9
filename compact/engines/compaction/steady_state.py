"""Slow relaxation of the bow wave: measurement of its drift, and jumps of the whole state along its mode.

After a contact length of travel a rolled layer differs from its steady state by one mode, a bow wave that is too high
or too low. With the area A of the wave ahead of the roller and the travel s,

    dA/ds = (A_steady - A)/relaxation length,    load and resistance linear in A

The relaxation length is ten to twenty contact lengths, far more than it is worth rolling. The slope dA/ds of a few
steps gives the distance to the steady state instead, and the layer jumps there along the difference of two settled
states, whose slopes give the relaxation length too:

    state <- state + (A_steady - A)/(A_2 - A_1) (state_2 - state_1),    length = (A_2 - A_1)/(slope_1 - slope_2)

The next steps restore equilibrium and yield, and remove what is not part of the mode.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from compact.engines.compaction.finite_strain_solid import SolidState
from compact.engines.compaction.roller_contact import ContactTractions
from compact.engines.compaction.roller_frame import transfer_state
from compact.engines.compaction.rolling import IncrementalRolling, RollingStep
from compact.numerics import Array

PREDICTION_TAPER = 0.5  # [-], distance ahead of the roller over the contact length from which jumps are predicted
MAX_CORRELATION = 0.9  # [-], of deviations from a line; a few steps do not show more
QUANTITIES = ("load", "resistance", "exit_density_ratio", "peak_pressure")  # of a `RollingStep`
LENGTH_EXPONENT = 2.0  # [-], of the relaxation length over the depth, roughly


@dataclass(frozen=True, eq=False)
class WaveDrift:
    """Wave, load, resistance and exit density at the end of some steps, and their slopes over the travel.

    Parameters
    ----------
    travel : float
        Travel of the steps [m].
    wave_area, wave_slope, wave_error : float
        Area of the wave [m2], its slope and the standard error of the slope [m], for deviations that are correlated
        from step to step.
    growth : float
        Mix that the wave takes up, as fed, per travel [m]: inflow less outflow at the exit column.
    values, slopes : ndarray, shape (4,)
        `QUANTITIES` [N/m, N/m, -, Pa], and their slopes over the travel [1/m].
    """

    travel: float
    wave_area: float
    wave_slope: float
    wave_error: float
    growth: float
    values: Array
    slopes: Array

    @classmethod
    def of_steps(cls, steps: Sequence[RollingStep]) -> Self:
        """Fit straight lines to some steps."""
        names = ("wave_area", "stored_area", *QUANTITIES)
        table = np.array([[getattr(step, name) for name in names] for step in steps])
        travel = np.array([step.travel for step in steps]) - steps[-1].travel
        lines = np.stack([np.ones_like(travel), travel], axis=1)
        ends, slopes = np.linalg.lstsq(lines, table, rcond=None)[0]
        deviation = table[:, 0] - lines @ [ends[0], slopes[0]]
        after, before = deviation[1:], deviation[:-1]
        correlation = np.clip(after @ before / max(before @ before, np.finfo(float).tiny), 0.0, MAX_CORRELATION)
        spread = np.sum(deviation**2) / max(len(steps) - 2, 1) / np.sum((travel - travel.mean()) ** 2)
        error = np.sqrt(spread * (1 + correlation) / (1 - correlation))  # of a sum of such deviations
        wave = -float(travel[0]), float(ends[0]), float(slopes[0]), float(error)
        return cls(*wave, float(slopes[1]), ends[2:], slopes[2:])


@dataclass(frozen=True, eq=False)
class BowWaveMode:
    """Difference of two settled states of one mesh.

    Parameters
    ----------
    state : SolidState
        Difference of the states of the layer.
    pressure : ndarray, shape (n,)
        Difference of the pressures of the surface nodes [Pa].
    wave_area : float
        Difference of the areas of the wave [m2].
    slopes : ndarray, shape (4,)
        Change of `QUANTITIES` with the area of the wave per area of the wave.
    """

    state: SolidState
    pressure: Array
    wave_area: float
    slopes: Array

    @classmethod
    def between(cls, first: IncrementalRolling, second: IncrementalRolling, slopes: Array) -> Self:
        """Return the mode from one settled state to another on the same mesh."""
        a, b = first.state, second.state
        points = b.points.map(np.subtract, a.points)
        difference = SolidState(b.displacement - a.displacement, points, b.work - a.work)
        area = second.steps[-1].wave_area - first.steps[-1].wave_area
        return cls(difference, second.contact.pressure - first.contact.pressure, area, slopes)

    def on_mesh(self, old: IncrementalRolling, new: IncrementalRolling) -> Self:
        """Return the mode interpolated from the mesh of one roller to that of another."""
        state = transfer_state(self.state, old.frame, new.frame)
        return replace(self, state=state, pressure=np.interp(new.frame.surface_x, old.frame.surface_x, self.pressure))

    def add_to(self, rolling: IncrementalRolling, wave_area: float) -> None:
        """Change the state of a roller along the mode, and the pressure of its multipliers.

        The prediction of the next step follows the change of the displacement ahead of the roller alone; behind it
        contains marks, which move with the mix.

        Parameters
        ----------
        rolling : IncrementalRolling
            Roller on the mesh of the mode.
        wave_area : float
            Change of the area of the wave [m2].
        """
        factor, state = wave_area / self.wave_area, rolling.state
        points = state.points.map(lambda values, mode: values + factor * mode, self.state.points)
        densest, plastic_work = np.maximum(points.max_density_ratio, points.density_ratio), points.plastic_work
        points = replace(points, max_density_ratio=densest, plastic_work=np.maximum(plastic_work, 0.0))
        change = factor * self.state.displacement
        moved = SolidState(state.displacement + change, points, state.work + factor * self.state.work)
        frame = rolling.frame
        share = np.clip(frame.nodes[:, :1] / (PREDICTION_TAPER * frame.contact_length), 0.0, 1.0)
        predicted = share * (change - frame.convect_displacement(change)) / len(rolling.parts)
        parts = []
        for part in rolling.parts:
            pressure = np.maximum(part.contact.pressure + factor * self.pressure, 0.0)
            contact = ContactTractions(pressure, part.contact.shear, part.contact.creepage)
            parts.append(replace(part, contact=contact, displacement_change=part.displacement_change + predicted))
        rolling.restart(moved, parts)


@dataclass(frozen=True, eq=False)
class Relaxation:
    """Slow relaxation of the bow wave.

    Parameters
    ----------
    length : float or None
        Relaxation length [m], None if unknown.
    mode : BowWaveMode or None
        Slow mode on the present mesh, None if unknown.
    """

    length: float | None = None
    mode: BowWaveMode | None = None

    def at_depth(self, ratio: float) -> Self:
        """Return the relaxation at a depth that differs by a ratio [-]."""
        return self if self.length is None else replace(self, length=self.length * ratio**LENGTH_EXPONENT)


@dataclass(frozen=True)
class ErrorParts:
    """Estimated relative errors of load and resistance [-], pairs.

    Parameters
    ----------
    mesh : tuple of float, or None
        Error of the finite elements; None for a single mesh.
    drift : tuple of float
        Distance to the steady state.
    start : tuple of float
        Scatter and transient.
    """

    mesh: tuple[float, float] | None = None
    drift: tuple[float, float] = (0.0, 0.0)
    start: tuple[float, float] = (0.0, 0.0)

    @property
    def total(self) -> tuple[float, float] | None:
        """Sums of the parts for load and resistance [-]; None without an estimate of the mesh."""
        if self.mesh is None:
            return None
        load, resistance = np.sum([self.mesh, self.drift, self.start], axis=0)
        return float(load), float(resistance)
