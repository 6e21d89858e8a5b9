"""Whole study of a scene, and its forming process, with tables, figures and files."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from compact.analysis import process, study
from compact.machine.ranking import CRITERIA
from compact.quantities import STROKE
from compact.report.tables import TableSpec, Tabular

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CRITERION_QUANTITIES = {name: criterion.quantity for name, criterion in CRITERIA.items()}


class Study(Tabular, study.Study):
    """Results of one scene, as `analysis.study.Study`, with tables, figures and files.

    Examples
    --------
    >>> from compact.api.scene import load_scene
    >>> study = Study(load_scene("studies/scenes/small.toml"))
    >>> study
    <study of Small: the published machine, three laws, engine formula, 3 laws>
    >>> study.stages.drive.rankings["peak_power"][0].run.name
    'reversal-3'
    """

    _index, _quantities = "law", CRITERION_QUANTITIES

    def columns(self) -> dict[str, list[Any]]:
        """Return the values of all laws by each criterion of the scene, in the order of the first."""
        criteria = list(self.stages.drive.rankings)
        values = {
            by: {place.run.name: place.value for place in ranked} for by, ranked in self.stages.drive.rankings.items()
        }
        order = [place.run.name for place in self.stages.drive.rankings[criteria[0]]]
        return {"law": order} | {by: [values[by][name] for name in order] for by in criteria}

    def plot(self) -> "Figure":
        """Draw the rankings of the laws by the criteria of the scene."""
        from compact.report.figures import draw_rankings

        return draw_rankings(self.stages.drive.places[self.scene.drive.kind], {})

    def write(self, directory: str | Path, force: bool = False) -> dict[str, Any]:
        """Write report, tables and figures, as `compact run` does.

        Parameters
        ----------
        directory : str or Path
            Directory of the results; created where it is missing.
        force : bool
            True to overwrite results of another scene.

        Returns
        -------
        dict
            Content of summary.json.
        """
        from compact.report.writer import write_study

        return write_study(self, directory, force)

    def __repr__(self) -> str:
        title = self.scene.title or "an untitled scene"
        return f"<study of {title}, engine {self.scene.accuracy.engine}, {len(self.stages.laws.prescribed)} laws>"

    def _repr_html_(self) -> str:
        computed = "rankings" in self.stages.drive.__dict__  # a view starts no computation
        return (self.table if computed else TableSpec(repr(self)[1:-1], {}, ())).to_html()


class Process(Tabular, process.ProcessStudy):
    """Forming process of a scene, as `analysis.process.ProcessStudy`, with tables, figures and files."""

    _quantities = STROKE

    def columns(self) -> dict[str, Any]:
        """Return the strokes on a section, per unit roller length."""
        from compact.report.process import stroke_columns

        return stroke_columns(self)

    def plot(self) -> "Figure":
        """Draw the section of the mix along the roller."""
        from compact.report.process import draw_section

        return draw_section(self)

    def write(self, directory: str | Path, force: bool = False) -> list[Path]:
        """Write tables, figures, fields and process.json, as `compact process` does.

        Parameters
        ----------
        directory, force
            As of `Study.write`.

        Returns
        -------
        list of Path
            Files written.
        """
        from compact.files import claimed_directory
        from compact.report.process import write_process

        with claimed_directory(directory, self.scene.hash, force) as place:
            return write_process(self, place)

    def __repr__(self) -> str:
        strokes = f"{self.problem.machine.strokes_on_section:.4g} strokes on a section"
        return f"<process of {self.scene.title or 'an untitled scene'}, {self.detail}, {strokes}>"
