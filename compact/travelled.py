"""The result of moving a roller through time: what the layer resists, instant by instant, and its fields."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from compact.results import write_mesh, write_pvd


@dataclass(frozen=True, eq=False)
class Travelled:
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

    def film(self, directory):
        """Write the frames as film/time=T.vtu and as film.pvd, their series over time, which comes last; its path."""
        if not self.frames:
            raise ValueError("no frames to film; ask for `frames` at the instants wanted when travelling")
        members = []
        for time, mesh in self.frames:
            path = Path(directory) / "film" / f"time={time!r}.vtu"
            write_mesh(mesh, path)
            members.append((time, path))
        series = Path(directory) / "film.pvd"
        write_pvd(series, members)
        return series
