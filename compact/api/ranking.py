"""Resistance of the mix to one cart as a callable F(v, a); ranking of motion laws, own ones too, against it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from compact.analysis.ranking_uncertainty import Place, places
from compact.analysis.stages.resistance import ResistanceLaw
from compact.api.tables import Items, TabularOverSpeed
from compact.drive import rank
from compact.machine.ranking import CRITERIA
from compact.motion.profile import MotionProfile
from compact.motion.tabulated import from_function, from_table
from compact.numerics import Array
from compact.numerics.validation import require_instance
from compact.quantities import MOTION, SPEED, Quantity
from compact.report.tables import TableSpec
from compact.resistance import ResistanceMap
from compact.scene.loader import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from compact.analysis.stages.drives import Stages

STROKE_TOLERANCE = 1e-3  # [-], difference of an own law from stroke and duration of the scene, over these

OwnLaw = MotionProfile | Callable[[Any], ArrayLike] | tuple[ArrayLike, ArrayLike]
QUANTITIES = {"speed": SPEED, "resistance": MOTION["cart_resistance"], "added_mass": MOTION["added_mass"]}
PLOTTED_SPEEDS = 9  # [-], of a resistance without samples


@dataclass(frozen=True, eq=False)
class CartResistance(TabularOverSpeed):
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
    def table(self) -> TableSpec:
        """Resistance [N] over the speed [m/s] of the samples, with their added masses [kg] where they are known."""
        law, speeds = self.law, np.linspace(0.0, self.largest_speed, PLOTTED_SPEEDS + 1)[1:]
        columns = {"speed": speeds, "resistance": np.asarray(self(speeds))}
        if isinstance(law, ResistanceMap):
            columns = {"speed": law.speeds, "resistance": law.forces}
            columns |= {} if law.added_masses is None else {"added_mass": law.added_masses}
        values = {name: each.tolist() for name, each in columns.items()}
        return TableSpec.of_columns(repr(self)[1:-1], values, QUANTITIES)

    @property
    def _attributes(self) -> dict[str, str]:
        return {"engine": self.engine}

    def plot(self) -> "Figure":
        """Draw the resistance over the speed, of an engine with memory at several accelerations too.

        Returns
        -------
        matplotlib.figure.Figure
        """
        from compact.report import contact_figures

        if isinstance(self.law, ResistanceMap):
            return contact_figures.draw_resistance(self.law, self.largest_acceleration)
        drawn = ResistanceMap(np.asarray(self.table["speed"]), np.asarray(self.table["resistance"]), 0.0)
        return contact_figures.draw_resistances({self.engine: drawn})

    def __repr__(self) -> str:
        error = "error unknown" if self.error is None else f"relative error {self.error:.1e}"
        speed = self.largest_speed
        return f"<resistance by {self.engine}, {float(self(speed)) / 1e3:.4g} kN at {speed:.3g} m/s, {error}>"


@dataclass(frozen=True, eq=False)
class Ranking(Items[Place]):
    """Motion laws in order of one criterion, a sequence of `Place`.

    Parameters
    ----------
    by : str
        Criterion.
    places : tuple of Place
        Places of the laws, the first law first.
    stages : Stages
        Stages that computed it.
    """

    by: str
    places: tuple[Place, ...]
    stages: "Stages"

    @property
    def runs(self) -> dict[str, Any]:
        """Run of each law under the drive of the scene, by name, in the order of the laws."""
        return self.stages.drive.runs

    _index = "rank"

    @property
    def items(self) -> tuple[Place, ...]:
        """Places of the laws."""
        return self.places

    @property
    def table(self) -> TableSpec:
        """Ranking: rank, law, value and its error in the SI unit, margin, tie, resolved."""
        quantity = CRITERIA[self.by].quantity
        known = {self.by: quantity, "error": quantity, "margin": Quantity("margin to the next law", "1")}
        names = ("rank", "law", self.by, "error", "margin", "tie", "resolved", "reason")
        columns = {name: [getattr(each, "value" if name == self.by else name) for each in self] for name in names}
        return TableSpec.of_columns(repr(self)[1:-1], columns, known)

    def plot(self) -> "Figure":
        """Draw a bar for each law, with its error.

        Returns
        -------
        matplotlib.figure.Figure
        """
        from compact.report.figures import draw_rankings

        return draw_rankings({self.by: list(self)}, {})

    def __repr__(self) -> str:
        drive, first = self.stages.drive.scene.drive.kind, self[0]
        return f"<{len(self)} laws by {CRITERIA[self.by].quantity.term}, {drive} drive; first {first.law}>"


def rank_laws(stages: "Stages", by: str) -> Ranking:
    """Rank the laws of a scene by a criterion.

    Parameters
    ----------
    stages : Stages
        Stages of the scene.
    by : str
        Criterion.

    Returns
    -------
    Ranking
    """
    drive = stages.drive
    return Ranking(by, tuple(places(rank(drive.runs.values(), by), by, drive.heavier_runs)), stages)


def own_laws(scene: Scene, laws: Mapping[str, OwnLaw]) -> tuple[MotionProfile, ...]:
    """Return own laws as motion profiles over the stroke and the duration of a scene.

    Parameters
    ----------
    scene : Scene
        Scene with stroke and duration.
    laws : mapping
        By name a `MotionProfile`, a travel [m] as a function of time [s], or columns of time [s] and travel [m].

    Returns
    -------
    tuple of MotionProfile

    Raises
    ------
    ValueError
        If a law has the name of one of the scene, another stroke or duration, or is not from rest to rest.
    """
    require_instance(Mapping, "laws by name", laws=laws)
    motion, found = scene.motion, []
    for name, given in laws.items():
        if name in (*scene.law_names, *(path.stem for path in scene.table_paths)):
            raise ValueError(f"the scene has a law '{name}' already; give the own law another name")
        if isinstance(given, MotionProfile):
            law = replace(given, name=name)
        elif callable(given):
            law = from_function(given, motion.duration, name)
        else:
            if not hasattr(given, "__len__") or len(given) != 2:
                words = "give a MotionProfile, a function of time, or columns of time and travel"
                raise ValueError(f"the law '{name}' is none, got {given!r}; {words}")
            law = from_table(*given, name=name)
        for key in ("stroke", "duration"):
            value, required = getattr(law, key), getattr(motion, key)
            if abs(value - required) > STROKE_TOLERANCE * required:
                raise ValueError(
                    f"the law '{name}' has the {key} {value:g}, the scene motion.{key} = {required:g}; scale the law, "
                    "or change the scene"
                )
        found.append(law)
    return tuple(found)
