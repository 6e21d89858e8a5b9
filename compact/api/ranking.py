"""Ranking of the motion laws of a scene, of own laws and under an own resistance."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, overload

from numpy.typing import ArrayLike

from compact.analysis.ranking_uncertainty import Place, places
from compact.api.tables import build_frame, render_html
from compact.drive import rank
from compact.machine.ranking import CRITERIA
from compact.motion.profile import MotionProfile
from compact.motion.tabulated import from_function, from_table
from compact.numerics.validation import require_instance
from compact.quantities import Quantity
from compact.scene.loader import Scene

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

    from compact.analysis.stages.drives import Stages

STROKE_TOLERANCE = 1e-3  # [-], difference of an own law from stroke and duration of the scene, over these

OwnLaw = MotionProfile | Callable[[Any], ArrayLike] | tuple[ArrayLike, ArrayLike]


@dataclass(frozen=True, eq=False)
class Ranking(Sequence[Place]):
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

    @overload
    def __getitem__(self, index: int) -> Place: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[Place]: ...

    def __getitem__(self, index: int | slice) -> Place | Sequence[Place]:
        return self.places[index]

    def __len__(self) -> int:
        return len(self.places)

    @property
    def _columns(self) -> dict[str, list[Any]]:
        names = {"rank": "rank", "law": "law", self.by: "value", "error": "error", "margin": "margin", "tie": "tie",
                 "resolved": "resolved", "reason": "reason"}  # fmt: skip
        return {column: [getattr(place, name) for place in self] for column, name in names.items()}

    @property
    def _quantities(self) -> dict[str, Quantity]:
        quantity = CRITERIA[self.by].quantity
        return {self.by: quantity, "error": quantity, "margin": Quantity("margin to the next law", "1")}

    def to_dataframe(self) -> "pandas.DataFrame":
        """Return the ranking as a table: rank, law, value and its error in the SI unit, margin, tie, resolved."""
        return build_frame(self._columns, self._quantities, "rank")

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

    def _repr_html_(self) -> str:
        return render_html(repr(self)[1:-1], self._columns, self._quantities)


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
