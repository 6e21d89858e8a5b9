"""What every contact engine takes and gives: a layer, a roller, and the result of rolling one over the other.

All engines share one call,

    rolled = engine.roll(layer, roller, material, speed)

so that a study swaps them by name. x runs along the travel, y up; the base lies at y = 0. Quantities are per unit
roller length, SI.

The result of moving a roller through time: what the layer resists, instant by instant, and its fields.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from pathlib import Path
from typing import Literal

import numpy as np

from compact.files import write_pvd_collection, write_vtu
from compact.numerics.validation import require_finite, require_nonnegative, require_positive

BaseCondition = Literal["bonded", "slip"]
RollerCondition = Literal["frictionless", "sliding", "free", "driven"]
GapGeometry = Literal["parabola", "circle", "deformed"]


HEIGHT_TOLERANCE = 1e-9  # of the layer's height: what decimal fractions of thicknesses may miss


@dataclass(frozen=True)
class Ply:
    """One ply of a layer: `thickness` [m] > 0; `stiffness`, its moduli over those of the material [-] > 0."""

    thickness: float
    stiffness: float

    def __post_init__(self):
        require_positive(thickness=self.thickness, stiffness=self.stiffness)


@dataclass(frozen=True)
class Layer:
    """A layer of mix on a rigid base: `height` H [m] > 0; `base` "bonded" or "slip"; `plies` from the base upwards.

        E(y, t) = c(y) E(t),  c the stiffness of the ply at y

    The plies stick to one another and share Poisson's ratio and the relaxation spectrum of the material: one function
    of time multiplies all of the stiffness. Without plies the layer is one of stiffness 1.
    """

    height: float
    base: BaseCondition = "bonded"
    plies: tuple[Ply, ...] = ()

    def __post_init__(self):
        require_positive(height=self.height)
        object.__setattr__(self, "plies", tuple(self.plies))
        total = sum(ply.thickness for ply in self.plies)
        if self.plies and abs(total - self.height) > HEIGHT_TOLERANCE * self.height:
            raise ValueError(
                f"`plies` must be as thick together as the layer is high, {self.height!r} m, got {total:.12g} m"
            )

    @cached_property
    def stack(self):
        """The plies, one at least."""
        return self.plies or (Ply(self.height, 1.0),)

    @property
    def top(self):
        """The ply under the roller."""
        return self.stack[-1]

    @cached_property
    def interfaces(self):
        """Heights [m] at which one ply ends and the next begins, ascending."""
        return tuple(accumulate(ply.thickness for ply in self.stack[:-1]))

    def stiffness(self, y):
        """c of the plies at the heights y [m], which are not those of interfaces."""
        return np.array([ply.stiffness for ply in self.stack])[np.searchsorted(self.interfaces, y)]


@dataclass(frozen=True)
class Roller:
    """A rigid roller and how deep, or how hard, it is pressed in.

    Exactly one of `indentation` [m], `load` P [N/m] and `peak_pressure` p0 [Pa] is given; the engine finds the others.
    `radius` R [m] > 0; `friction` mu >= 0 of mix on roller. `rolling` says which way the traction acts on the mix:
    "frictionless" none, "sliding" along the travel, "free" none in sum, "driven" against it; the engines "formula" and
    "spectral" take "driven" as full slip, "fem" and "compaction" let a free or driven roller stick and slip under a
    torque. `profile`
    is where the gap is measured: vertical to the parabola, vertical to the circle, or normal to the circle on the
    deformed surface.
    """

    radius: float
    indentation: float | None = None
    friction: float = 0.0
    rolling: RollerCondition = "frictionless"
    profile: GapGeometry = "parabola"
    load: float | None = None
    peak_pressure: float | None = None

    def __post_init__(self):
        require_positive(radius=self.radius)
        require_nonnegative(friction=self.friction)
        given = self._given
        if len(given) != 1:
            raise ValueError(f"give one of `indentation`, `load`, `peak_pressure`, got {sorted(given) or 'none'}")
        require_positive(**given)

    @property
    def target(self):
        """Name and value of what is prescribed."""
        return next(iter(self._given.items()))

    @property
    def _given(self):
        targets = {name: getattr(self, name) for name in ("indentation", "load", "peak_pressure")}
        return {name: value for name, value in targets.items() if value is not None}


def require_torque_allowed(roller, torque):
    """A torque is for a roller that turns with friction; one that is driven needs it."""
    turns = roller.rolling in ("free", "driven")
    if torque is not None:
        require_finite(torque=torque)
        if torque and not (turns and roller.friction > 0):
            raise ValueError(
                f"`torque` needs a roller that is 'free' or 'driven' and has `friction`, got {torque!r} for "
                f"'{roller.rolling}' with {roller.friction!r}"
            )
    elif roller.rolling == "driven":
        raise ValueError("`torque` must be given for a 'driven' roller, got None; a 'free' one needs none")


def require_target_reached(name, wanted, reached, tolerance, scale=None):
    """Raise RuntimeError unless a prescribed quantity is reached.

    Parameters
    ----------
    name : of the quantity, as the user prescribes it
    wanted, reached : its values, of one unit
    tolerance : promised by the engine [-], relative to `scale`
    scale : size of the quantity; `wanted` unless given
    """
    scale = abs(wanted) if scale is None else scale
    if not abs(reached - wanted) <= tolerance * scale:
        raise RuntimeError(
            f"`{name}` {wanted:.9g} was prescribed and {reached:.9g} reached: {abs(reached - wanted) / scale:.1e} off, "
            f"where {tolerance:.0e} is promised; the contact is not returned"
        )


def require_on_target(rolled, roller, tolerance, *, exit_density_ratio=None, torque=None):
    """Raise RuntimeError unless a contact has what was prescribed: every engine calls this before it returns.

    Parameters
    ----------
    rolled : ContactResult
    roller : Roller, whose target is prescribed
    tolerance : promised by the engine, relative [-]
    exit_density_ratio : prescribed instead of the target of the roller, or None
    torque : (prescribed, reached) of a roller that sticks and slips [N], or None; the tolerance is of the largest
        torque that friction holds
    """
    name, wanted = roller.target if exit_density_ratio is None else ("exit_density_ratio", exit_density_ratio)
    require_target_reached(name, wanted, getattr(rolled, name), tolerance)
    if torque is not None:
        require_target_reached("torque", *torque, tolerance, roller.friction * rolled.load * roller.radius)


@dataclass(frozen=True)
class ContactResult:
    """One contact: what the layer does to the roller, per unit roller length.

    load : normal force P [N/m]
    resistance : minus the x-force of the mix on the roller [N/m]; odd in speed
    leading, trailing : contact edges [m] from the lowest point, + ahead
    x, pressure, shear_traction : along the contact [m], [Pa], [Pa], shape (n,); pressure positive in compression
    error : (load, resistance) estimated relative errors, or None where the engine cannot tell
    work_residual : relative gap of the energy balance of steady rolling, or None for an engine without fields
    peak_pressure : p0, between the samples too [Pa]
    history : what the engine went through, a row for each iteration; empty for a closed form

    RuntimeError where there is no contact, or no number for its resistance.
    """

    load: float
    resistance: float
    leading: float
    trailing: float
    x: np.ndarray
    pressure: np.ndarray
    shear_traction: np.ndarray
    error: tuple[float, float] | None = None
    work_residual: float | None = None
    peak_pressure: float = np.nan
    history: tuple = ()

    def __post_init__(self):
        if not (0 < self.load < np.inf and self.trailing < self.leading):
            raise RuntimeError(
                f"the roller does not touch the layer: load {self.load:.3g} N/m, contact from {self.trailing:.3g} to "
                f"{self.leading:.3g} m; press deeper"
            )
        if not np.isfinite(self.resistance):
            raise RuntimeError(f"no resistance found, got {self.resistance} N/m at a load of {self.load:.3g} N/m")


@dataclass(frozen=True, eq=False)
class TransientResult:
    """A motion of one roller over a layer, per unit roller length, at the ends of its time steps, arrays of shape (n,).

    time [s], from 0 on;  position, velocity : of the motion there [m], [m/s]
    load : normal force P [N/m]
    resistance : minus the x-force of the mix on the roller [N/m], + against a motion along +x; the x axis stays
    leading, trailing : contact edges [m] from the lowest point, the one at larger and the one at smaller x,
        whichever way the roller goes
    angle : by which a roller with friction that turns has turned [rad], + as it rolls along +x, or None
    error : estimated error of the resistance from the time steps, the largest over the largest |resistance|, or None
    steps : number of time steps solved, those of the estimate too
    frames : (time, meshio mesh of the fields) of each instant that was asked for

    RuntimeError where a number is not finite.
    """

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    load: np.ndarray
    resistance: np.ndarray
    leading: np.ndarray
    trailing: np.ndarray
    error: float | None = None
    steps: int = 0
    frames: tuple = ()
    angle: np.ndarray | None = None

    def __post_init__(self):
        for name in ("load", "resistance"):
            lost = np.flatnonzero(~np.isfinite(getattr(self, name)))
            if lost.size:
                raise RuntimeError(f"no {name} found at t = {self.time[lost[0]]:.6g} s")

    def write_frames(self, directory):
        """Write the frames as film/time=T.vtu and as film.pvd, their series over time, which comes last; its path."""
        if not self.frames:
            raise ValueError("no frames to film; ask for `frames` at the instants wanted when travelling")
        members = []
        for time, mesh in self.frames:
            path = Path(directory) / "film" / f"time={time!r}.vtu"
            write_vtu(mesh, path)
            members.append((time, path))
        series = Path(directory) / "film.pvd"
        write_pvd_collection(series, members)
        return series
