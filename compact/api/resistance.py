"""Resistance of the mix to one cart as a callable F(v, a), with its samples as a table and a figure."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from compact.analysis.stages.resistance import ResistanceLaw
from compact.api.tables import build_dataset, build_frame, render_html
from compact.numerics import Array
from compact.quantities import MOTION, SPEED
from compact.resistance import ResistanceMap

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.figure import Figure

QUANTITIES = {"speed": SPEED, "resistance": MOTION["cart_resistance"], "added_mass": MOTION["added_mass"]}
PLOTTED_SPEEDS = 9  # [-], of a resistance without samples


@dataclass(frozen=True, eq=False)
class CartResistance:
    """Resistance of the mix to one cart; call it with velocities [m/s] and accelerations [m/s2].

    Parameters
    ----------
    law : ResistanceMap, DryResistance or callable
        Resistance [N] of velocity and acceleration, as the drives take it.
    engine : str
        Name of the engine.
    largest_speed : float
        Speed up to which it is known [m/s].
    largest_acceleration : float
        Largest acceleration of the laws of the scene [m/s2].
    error : float or None
        Relative error estimate [-], of the interpolation and the engine; None if unknown.
    """

    law: ResistanceLaw
    engine: str
    largest_speed: float
    largest_acceleration: float
    error: float | None

    def __call__(self, velocity: ArrayLike, acceleration: ArrayLike = 0.0) -> Array:
        """Return the resistance [N], of the common shape of velocity and acceleration."""
        return self.law(np.asarray(velocity, float), np.asarray(acceleration, float))

    @property
    def odd(self) -> bool:
        """True if it is odd in the velocity by construction."""
        return getattr(self.law, "odd", False)

    @property
    def _columns(self) -> dict[str, Any]:
        """Speed and resistance of the samples, with their added masses where they are known."""
        if not isinstance(self.law, ResistanceMap):
            speeds = np.linspace(0.0, self.largest_speed, PLOTTED_SPEEDS + 1)[1:]
            return {"speed": speeds, "resistance": np.asarray(self(speeds))}
        columns: dict[str, Any] = {"speed": self.law.speeds, "resistance": self.law.forces}
        return columns if self.law.added_masses is None else columns | {"added_mass": self.law.added_masses}

    def to_dataframe(self) -> "pandas.DataFrame":
        """Return the samples as a table over the speed [m/s]: resistance [N], and added mass [kg] where it is known."""
        return build_frame(self._columns, QUANTITIES, "speed")

    def to_xarray(self) -> "xarray.Dataset":
        """Return the samples as a dataset over the speed [m/s], with units."""
        return build_dataset(self._columns, QUANTITIES, "speed", {"engine": self.engine})

    def plot(self) -> "Figure":
        """Draw the resistance over the speed, of an engine with memory at several accelerations too.

        Returns
        -------
        matplotlib.figure.Figure
        """
        from compact.report import contact_figures

        if isinstance(self.law, ResistanceMap):
            return contact_figures.draw_resistance(self.law, self.largest_acceleration)
        columns = self._columns
        drawn = ResistanceMap(np.asarray(columns["speed"]), np.asarray(columns["resistance"]), 0.0)
        return contact_figures.draw_resistances({self.engine: drawn})

    def __repr__(self) -> str:
        error = "error unknown" if self.error is None else f"relative error {self.error:.1e}"
        speed = self.largest_speed
        return f"<resistance by {self.engine}, {float(self(speed)) / 1e3:.4g} kN at {speed:.3g} m/s, {error}>"

    def _repr_html_(self) -> str:
        return render_html(repr(self)[1:-1], self._columns, QUANTITIES)
