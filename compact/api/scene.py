"""A scene that computes its own results: contacts, resistance, ranking, sweep, process and whole study.

    import compact
    scene = compact.load_scene("scene.toml")
    scene.roll([0.05, 0.1, 0.2], engine="column").to_dataframe()
    scene.rank(by="peak_power").plot()

Each method returns a result with `to_dataframe`, `plot` and, where it applies, `to_xarray` and `to_vtk`; a sweep is an
xarray dataset. Nothing is kept between calls: a `study` computes each stage once.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Literal

from compact.files import default_directory
from compact.numerics.validation import require_instance
from compact.report.progress import Progress, spinning
from compact.scene import loader

if TYPE_CHECKING:
    import xarray

    from compact.analysis.stages.resistance import ResistanceLaw
    from compact.api import results
    from compact.material.state_update import StateUpdate


class Scene(loader.Scene):
    """One machine with one mix and one motion, and the methods that compute its results.

    `load_scene`, `parse_scene` and `Scene.replaced` are the only constructors.
    """

    def roll(
        self,
        speeds: float | Sequence[float] | None = None,
        *,
        engine: str | None = None,
        material: "StateUpdate | None" = None,
    ) -> "results.Contacts":
        """Compute the contact of one roller at some speeds.

        Parameters
        ----------
        speeds : float or sequence of float, optional
            Speeds of the roller [m/s]; those of the scene by default.
        engine : str, optional
            Contact engine; that of the scene by default. Keys of its table [compare.ENGINE] apply.
        material : StateUpdate, optional
            Own material in place of the mix, for the engine "column".

        Returns
        -------
        Contacts

        Raises
        ------
        ValueError
            If the engine does not cover the scene, or does not take the material.
        RuntimeError
            If a contact does not converge.
        """
        from compact.api.results import Contacts

        with spinning("contacts"):
            return Contacts.of(self._by(engine), speeds, material)

    def resistance(self, *, engine: str | None = None) -> "results.CartResistance":
        """Compute the resistance of the mix to one cart over the speeds of the motion laws.

        Parameters
        ----------
        engine : str, optional
            As of `roll`.

        Returns
        -------
        CartResistance
            A function of velocity [m/s] and acceleration [m/s2].
        """
        from compact.api.results import CartResistance

        with spinning("resistance"):
            return CartResistance.of(self._by(engine))

    def rank(
        self,
        by: str | None = None,
        *,
        engine: str | None = None,
        laws: "Mapping[str, results.OwnLaw] | None" = None,
        resistance: "ResistanceLaw | None" = None,
    ) -> "results.Ranking":
        """Rank the motion laws by the demand on the drive of the scene.

        Parameters
        ----------
        by : str, optional
            Criterion, such as "peak_force"; the first of the scene by default.
        engine : str, optional
            As of `roll`.
        laws : mapping, optional
            Own laws in addition to those of the scene, by name: a `MotionProfile`, the travel [m] as a function of time
            [s], or columns of time and travel.
        resistance : callable, optional
            Resistance of one cart [N] as a function F(v, a) of velocity [m/s] and acceleration [m/s2], in place of that
            of the engine. It opposes the motion: F(-v, a) < 0 < F(v, a). The loads of the rollers remain those of the
            engine.

        Returns
        -------
        Ranking
        """
        from compact.api.results import Ranking

        with spinning("drives"):
            return Ranking.of(self._by(engine), self.drive.rank_by[0] if by is None else by, laws or {}, resistance)

    def decide(self, *, engine: str | None = None) -> "results.Decision":
        """Decide for one law, with the sizes of its machine, their ranges and margins, and one alternative.

        Parameters
        ----------
        engine : str, optional
            As of `roll`.

        Returns
        -------
        Decision

        Raises
        ------
        RuntimeError
            If no law has finite peaks by every model.
        """
        from compact.api.results import Decision

        with Progress() as line:
            return Decision.of(self._by(engine), line)

    def sweep(
        self,
        vary: Mapping[str, Any],
        *,
        engine: str | None = None,
        rank: bool = False,
        workers: int = 1,
        out: str | Path | None = None,
        direct: int | Literal["all"] | None = None,
    ) -> "xarray.Dataset":
        """Compute many scenes with keys varied, as `compact sweep` does.

        Parameters
        ----------
        vary : mapping
            Values by key path: a sequence of values, or a text LOW:HIGH:N for N values, ~N for N Sobol points over the
            spread of a parameter of the mix.
        engine : str, optional
            As of `roll`.
        rank : bool
            True to rank the motion laws at every point as well.
        workers : int
            Worker processes; with more than one, a script needs `if __name__ == "__main__"`.
        out : str or Path, optional
            Directory of checkpoints and sweep.nc, whose points another call uses; none by default.
        direct : int or "all", optional
            Points that the engine "compaction" computes itself; columns corrected by them give the others.

        Returns
        -------
        xarray.Dataset
            Results over the varied keys, with units; `reason` says why a point has none.
        """
        from compact.analysis.worker_pool import choose_executor
        from compact.sweep.corrected import create_sweep
        from compact.sweep.design import Axis, read_design

        require_instance(Mapping, "values by key path", vary=vary)
        varied = [
            read_design(f"{key}={values}") if isinstance(values, str) else Axis(key, tuple(_plain(key, values)))
            for key, values in vary.items()
        ]
        many = create_sweep(self._by(engine), varied, rank=rank, direct=direct)
        with TemporaryDirectory() as temporary, Progress(total=many.steps) as line:
            line.begin("points")
            place, step = temporary if out is None else out, lambda parts, _: line.advance(parts)
            return many.run(place, executor=choose_executor(workers), resume=out is not None, step=step).load()

    def forming_process(self, detail: Literal["columns", "deep"] = "columns") -> "results.Process":
        """Compute the forming process of the table [process].

        Parameters
        ----------
        detail : {"columns", "deep"}
            Columns alone, or with lumped lifts in two dimensions on one mesh, or on three.

        Returns
        -------
        Process
            Its results are computed when first used.
        """
        from compact.api.results import Process

        return Process(self, detail)

    def laboratory_tests(self) -> "results.LaboratoryTests":
        """Apply the laboratory tests to the mix, as `compact material` does.

        Returns
        -------
        LaboratoryTests
        """
        from compact.api.results import LaboratoryTests

        return LaboratoryTests.of(self)

    def study(self, *, engine: str | None = None) -> "results.Study":
        """Return the whole study of the scene, whose results are computed when first used.

        Parameters
        ----------
        engine : str, optional
            As of `roll`.

        Returns
        -------
        Study
        """
        from compact.api.results import Study

        return Study(self._by(engine))

    def run(self, out: str | Path | None = None, *, force: bool = False) -> "results.Study":
        """Compute the whole study and write report, tables and figures, as `compact run` does.

        Parameters
        ----------
        out : str or Path, optional
            Directory of the results; out/NAME by default, with the name of the scene file and its changed values.
        force : bool
            True to overwrite results of another scene.

        Returns
        -------
        Study
        """
        from compact.api.results import Study

        directory = Path(out) if out is not None else default_directory(self.file, "", self.changed_values)
        with Progress() as line:
            study = Study(self, line.begin, directory, line.report)
            study.write(directory, force)
        return study

    def _by(self, engine: str | None) -> "Scene":
        """Return the scene of an engine; the scene itself for its own."""
        return self if engine in (None, self.accuracy.engine) else self.with_engine(str(engine))

    def __repr__(self) -> str:
        return f"<scene {self.title or 'an untitled scene'}, {self.file}, engine {self.accuracy.engine}>"

    def __str__(self) -> str:
        return repr(self)


load_scene, parse_scene = Scene.load, Scene.parse


def _plain(key: str, values: Any) -> list[Any]:
    """Return the values of a key, an array or a sequence, as plain Python values."""
    plain = values.tolist() if hasattr(values, "tolist") else values
    if not isinstance(plain, Iterable) or isinstance(plain, bytes):
        raise ValueError(f"`vary` must have a list of values for {key}, got {plain!r}")
    return list(plain)
