"""Slow relaxation of the bow wave: measurement of its drift, and jumps of the whole state along its mode.

After a contact length of travel a rolled layer differs from its steady state by one mode, a bow wave that is too high
or too low. With the area A of the wave ahead of the roller and the travel s,

    dA/ds = (A_steady - A)/relaxation length,    load and resistance linear in A

The relaxation length is about ten contact lengths, far more than it is worth rolling. The slope dA/ds of a few steps
gives the distance to the steady state instead, and the layer jumps there along the difference of two settled states:

    state <- state + (A_steady - A)/(A_2 - A_1) (state_2 - state_1)

The next steps restore equilibrium and yield, and remove what is not part of the mode.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Self

import numpy as np

from compact.engines.compaction.finite_strain_solid import POINT_FIELDS, FloatArray, SolidState
from compact.engines.compaction.incremental_rolling import IncrementalRolling, RollingStep
from compact.engines.compaction.roller_contact import ContactTractions
from compact.engines.compaction.roller_frame import transfer_state
from compact.material.cap_plasticity import MaterialPoint

QUANTITIES = ("load", "resistance", "exit_density_ratio", "peak_pressure")  # of a `RollingStep`
MIN_SLOPE_ERROR = 0.02  # [-], least error of a slope of the wave over the largest one in a fit
MIN_CROSSING_CHANGE = 0.01  # [-], least change of the wave between states that bracket the steady one
LENGTH_EXPONENT = 2.0  # [-], of the relaxation length over the depth, roughly
CROSSING_STATES = 3  # [-], successive settled states that show an oscillation
PAIRS = 3  # [-], last settled states from which the relaxation length follows


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
    pressure: FloatArray
    wave_area: float
    slopes: FloatArray

    @classmethod
    def between(cls, first: IncrementalRolling, second: IncrementalRolling, slopes: FloatArray) -> Self:
        """Return the mode from one settled state to another on the same mesh."""
        a, b = first.state, second.state
        difference = SolidState(
            b.displacement - a.displacement,
            MaterialPoint(*(getattr(b.points, name) - getattr(a.points, name) for name in POINT_FIELDS)),
            b.work - a.work,
        )
        area = second.steps[-1].wave_area - first.steps[-1].wave_area
        return cls(difference, second.contact.pressure - first.contact.pressure, area, slopes)

    def on_mesh(self, old: IncrementalRolling, new: IncrementalRolling) -> Self:
        """Return the mode interpolated from the mesh of one roller to that of another."""
        x, known = (rolling.frame.nodes[rolling.frame.surface_nodes, 0] for rolling in (new, old))
        state = transfer_state(self.state, old.frame, new.frame)
        return replace(self, state=state, pressure=np.interp(x, known, self.pressure))

    def add_to(self, rolling: IncrementalRolling, wave_area: float) -> None:
        """Change the state of a roller along the mode.

        Parameters
        ----------
        rolling : IncrementalRolling
            Roller on the mesh of the mode.
        wave_area : float
            Change of the area of the wave [m2].
        """
        factor, state = wave_area / self.wave_area, rolling.state
        points = {
            name: getattr(state.points, name) + factor * getattr(self.state.points, name) for name in POINT_FIELDS
        }
        points["max_density_ratio"] = np.maximum(points["max_density_ratio"], points["density_ratio"])
        change = factor * self.state.displacement
        moved = SolidState(state.displacement + change, MaterialPoint(**points), state.work + factor * self.state.work)
        pressure = np.maximum(rolling.contact.pressure + factor * self.pressure, 0.0)
        rolling.restart(moved, ContactTractions(pressure, rolling.contact.shear, rolling.contact.creepage), change)


@dataclass(frozen=True, eq=False)
class Relaxation:
    """Slow relaxation of the bow wave.

    Parameters
    ----------
    length : float or None
        Relaxation length [m], None if unknown.
    mode : BowWaveMode or None
        Slow mode on the present mesh, None if unknown.
    first_length : float or None
        Relaxation length on the first mesh [m]; a finer mesh may shorten `length` where its wave oscillates.
    """

    length: float | None = None
    mode: BowWaveMode | None = None
    first_length: float | None = None

    def at_depth(self, ratio: float) -> Self:
        """Return the relaxation at a depth that differs by a ratio [-]."""
        factor = ratio**LENGTH_EXPONENT
        lengths = (None if length is None else length * factor for length in (self.length, self.first_length))
        return replace(self, **dict(zip(("length", "first_length"), lengths, strict=True)))


@dataclass(frozen=True, eq=False)
class WaveDrift:
    """Wave, load, resistance and exit density at the end of some steps, and their slopes over the travel.

    Parameters
    ----------
    travel : float
        Travel of the steps [m].
    wave_area, wave_slope, wave_error : float
        Area of the wave [m2], its slope and the standard error of the slope [m].
    values, slopes : ndarray, shape (4,)
        `QUANTITIES` [N/m, N/m, -, Pa] and their slopes over the travel [1/m].
    """

    travel: float
    wave_area: float
    wave_slope: float
    wave_error: float
    values: FloatArray
    slopes: FloatArray

    @classmethod
    def of_steps(cls, steps: Sequence[RollingStep]) -> Self:
        """Fit straight lines to some steps."""
        table = np.array([[getattr(step, name) for name in ("wave_area", *QUANTITIES)] for step in steps])
        travel = np.array([step.travel for step in steps]) - steps[-1].travel
        lines = np.stack([np.ones_like(travel), travel], axis=1)
        ends, slopes = np.linalg.lstsq(lines, table, rcond=None)[0]
        scatter = np.sum((table[:, 0] - lines @ [ends[0], slopes[0]]) ** 2) / max(len(steps) - 2, 1)
        error = np.sqrt(scatter / np.sum((travel - travel.mean()) ** 2))
        return cls(-float(travel[0]), float(ends[0]), float(slopes[0]), float(error), ends[1:], slopes[1:])


def relaxation_length(drifts: Sequence[WaveDrift]) -> float | None:
    """Return the relaxation length of the wave [m] from settled states of one mesh, None if they give none.

    Parameters
    ----------
    drifts : sequence of WaveDrift
        Drifts at successive settled states.
    """
    if len(drifts) < 2:
        return None
    area, slope, error = np.array([(d.wave_area, d.wave_slope, d.wave_error) for d in drifts[-PAIRS:]]).T
    weights = 1 / (error**2 + (MIN_SLOPE_ERROR * np.abs(slope).max()) ** 2)
    from_mean = area - np.average(area, weights=weights)
    spread = np.sum(weights * from_mean**2)
    decay = -np.sum(weights * from_mean * slope) / spread if spread > 0 else 0.0
    return float(1 / decay) if decay > 0 else None


def crossing_length(drifts: Sequence[WaveDrift]) -> float | None:
    """Return the relaxation length [m] from the last of three waves that oscillate about the steady one, else None.

    The first drift on a mesh contains the transient of the transfer; one change of sign is no oscillation.

    Parameters
    ----------
    drifts : sequence of WaveDrift
        Drifts at successive settled states.
    """
    if len(drifts) < CROSSING_STATES:
        return None
    slopes = [drift.wave_slope for drift in drifts[-CROSSING_STATES:]]
    if any(a * b >= 0 for a, b in pairwise(slopes)):
        return None
    before, last = drifts[-2:]
    if abs(last.wave_area - before.wave_area) < MIN_CROSSING_CHANGE * last.wave_area:
        return None
    secant = (last.wave_area - before.wave_area) / (before.wave_slope - last.wave_slope)
    return secant if secant > 0 else None
