"""Results of a scene as tables, figures and files: contacts, resistance, ranking, laboratory tests, study, process."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from compact.analysis import contact_cases, material_tests, pore_air, process, study
from compact.analysis.sizing import decision
from compact.analysis.stages.contacts import ContactStage, contact_stage
from compact.analysis.stages.drives import Place, Stages, build_stages, places
from compact.analysis.stages.resistance import ResistanceLaw
from compact.api.fields import Fields
from compact.drive import rank
from compact.engines.column.engine import roll
from compact.files import claimed_directory
from compact.machine.ranking import CRITERIA
from compact.material.state_update import StateUpdate
from compact.motion.profile import MotionProfile
from compact.motion.tabulated import from_function, from_table
from compact.numerics import Array
from compact.numerics.validation import as_numbers, require_instance, require_known
from compact.quantities import CONTACT, MOTION, SPEED, STROKE, Quantity
from compact.report.progress import Progress
from compact.report.tables import OF_ROW, TableSpec, Tabular
from compact.resistance import ResistanceMap
from compact.rolling_contact import Contact
from compact.scene.loader import Scene
from compact.turning import StrokeResistance

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STROKE_TOLERANCE = 1e-3  # [-], difference of an own law from stroke and duration of the scene, over these
PLOTTED_SPEEDS = 9  # [-], of a resistance without samples
ERROR = Quantity("relative error estimate", "1")
OWN_CONTACT = {"load_error": ERROR, "resistance_error": ERROR, "iterations": Quantity("iterations", "1")}
RESISTANCE = {"speed": SPEED, "resistance": MOTION["cart_resistance"], "added_mass": MOTION["added_mass"]}

OwnLaw = MotionProfile | Callable[[Any], ArrayLike] | tuple[ArrayLike, ArrayLike]


@dataclass(frozen=True, eq=False, repr=False)
class Contacts(Tabular, Sequence[Contact]):
    """Contacts of one roller, a sequence of the results of the first pass at each speed.

    The table has the scalar results that have a value, over the speed [m/s], per unit roller length.

    Parameters
    ----------
    records : tuple of Contact
        Scalar results per unit roller length, with the effect of the pore air where the scene has it.
    passes : tuple of tuple of Contact
        Results of all passes at each speed.
    stage : ContactStage
        Stage that computed them.
    title : str
        Title of the scene.
    """

    records: tuple[Contact, ...]
    passes: tuple[tuple[Contact, ...], ...]
    stage: ContactStage
    title: str = ""

    _index, _quantities = "speed", CONTACT | OWN_CONTACT

    @classmethod
    def of(cls, scene: Scene, speeds: float | Sequence[float] | None, material: StateUpdate | None) -> Self:
        """Compute the contacts of a scene, see `Scene.roll`."""
        stage = contact_stage(scene)
        given = as_numbers("speeds", contact_cases.contact_speeds(scene) if speeds is None else speeds)
        if given.ndim > 1 or not given.size:
            raise ValueError(f"`speeds` must hold at least one speed, got {given.tolist()}; give a list in m/s")
        records, passes = [], list[tuple[Contact, ...]]()
        for speed in map(float, np.atleast_1d(given)):
            if material is None:
                passes.append(stage.passes_at(speed, passes[-1] if passes else None))
                records.append(stage.record(speed, passes[-1]))
            else:
                passes.append((roll_material(scene, material, speed),))
                records.append(contact_cases.contact_record(stage.engine.name, speed, passes[-1]))
        return cls(tuple(records), tuple(passes), stage, scene.title)

    def __getitem__(self, index: Any) -> Any:
        return [first for first, *_ in self.passes][index]

    def __len__(self) -> int:
        return len(self.passes)

    @property
    def engine(self) -> str:
        """Name of the engine."""
        return self.stage.engine.name

    @property
    def speeds(self) -> tuple[float, ...]:
        """Speed of the roller in each contact [m/s]."""
        return tuple(each.speed for each in self.records)

    def columns(self) -> dict[str, list[Any]]:
        """Return the scalar results that have a value."""
        found = {name: [getattr(each, name) for each in self.records] for name in self._quantities}
        return {name: values for name, values in found.items() if any(value is not None for value in values)}

    def plot(self) -> "Figure":
        """Draw load and rolling-resistance coefficient over the speed."""
        from compact.report.contact_figures import draw_loads

        return draw_loads(self.records)

    @property
    def fields(self) -> Fields:
        """Fields inside the layer at each speed, by an engine that has them.

        Raises
        ------
        ValueError
            If the engine has no fields.
        """
        frames = tuple((speed, self.stage.field_mesh(each)) for speed, each in zip(self.speeds, self, strict=True))
        return Fields(frames, "speed", tuple(self))

    def to_vtk(self, directory: str | Path) -> Path:
        """Write the fields as VTU files with a PVD collection of ParaView; see `Fields.to_vtk`."""
        return self.fields.to_vtk(directory)

    def __repr__(self) -> str:
        words = f"contact by {self.engine} at {self.speeds[0]:.3g} m/s"
        if len(self) > 1:
            words = f"{len(self)} contacts by {self.engine}, {min(self.speeds):.3g} to {max(self.speeds):.3g} m/s"
        return f"<{words}{', ' + self.title if self.title else ''}>"


@dataclass(frozen=True, eq=False, repr=False)
class CartResistance(Tabular):
    """Resistance of the mix to one cart far from a turn; call it with velocities [m/s] and accelerations [m/s2].

    The table has the resistance [N] over the speed [m/s] of the samples, and their added masses [kg] if known.

    Parameters
    ----------
    law : ResistanceMap, DryResistance, StrokeResistance or callable
        Resistance [N] of velocity and acceleration, and of the travel since a turn, as the drives take it.
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

    _index, _quantities = "speed", RESISTANCE

    @classmethod
    def of(cls, scene: Scene) -> Self:
        """Compute the resistance of a scene, see `Scene.resistance`."""
        stages = build_stages(scene)
        law, peaks = stages.resistance.resistance, [each.forward.peaks() for each in stages.laws.prescribed.values()]
        fastest = max((each.velocity for each in peaks), default=scene.mean_speed)
        strongest = max((each.acceleration for each in peaks), default=0.0)
        known = getattr(stages.resistance.steady_law, "speeds", (fastest,))[-1]
        return cls(law, scene.accuracy.engine, float(known), float(strongest), stages.resistance.error)

    def __call__(self, velocity: ArrayLike, acceleration: ArrayLike = 0.0) -> Array:
        """Return the resistance [N], of the common shape of velocity and acceleration."""
        return self.law(np.asarray(velocity, float), np.asarray(acceleration, float))

    @property
    def _samples(self) -> ResistanceMap:
        steady = self.law.resistance if isinstance(self.law, StrokeResistance) else self.law
        if isinstance(steady, ResistanceMap):
            return steady
        speeds = np.linspace(0.0, self.largest_speed, PLOTTED_SPEEDS + 1)[1:]
        return ResistanceMap(speeds, np.asarray(self(speeds)), 0.0)

    def columns(self) -> dict[str, list[float]]:
        """Return speeds, resistances and added masses of the samples."""
        found = self._samples
        known = {"speed": found.speeds, "resistance": found.forces, "added_mass": found.added_masses}
        return {name: values.tolist() for name, values in known.items() if values is not None}

    def plot(self) -> "Figure":
        """Draw the resistance over the speed, of an engine with memory at several accelerations too."""
        from compact.report.contact_figures import draw_resistance

        return draw_resistance(self._samples, self.largest_acceleration)

    def __repr__(self) -> str:
        error = "error unknown" if self.error is None else f"relative error {self.error:.1e}"
        speed = self.largest_speed
        return f"<resistance by {self.engine}, {float(self(speed)) / 1e3:.4g} kN at {speed:.3g} m/s, {error}>"


@dataclass(frozen=True, eq=False, repr=False)
class Ranking(Tabular, Sequence[Place]):
    """Motion laws in order of one criterion, a sequence of `Place`.

    The table has rank, law, value and its error in the SI unit, margin, tie, and whether the rank is resolved.

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
    stages: Stages

    _index = "rank"

    @classmethod
    def of(cls, scene: Scene, by: str, laws: Mapping[str, OwnLaw], resistance: "CartResistance | Any | None") -> Self:
        """Rank the laws of a scene, see `Scene.rank`."""
        require_known("criterion", by, tuple(CRITERIA))
        given = resistance.law if isinstance(resistance, CartResistance) else resistance
        stages = build_stages(scene, own_laws=own_laws(scene, laws), own_resistance=given)
        order = rank(stages.drive.runs.values(), by)
        return cls(by, tuple(places(order, by, stages.drive.heavier_runs)), stages)

    def __getitem__(self, index: Any) -> Any:
        return self.places[index]

    def __len__(self) -> int:
        return len(self.places)

    @property
    def runs(self) -> dict[str, Any]:
        """Run of each law under the drive of the scene, by name, in the order of the laws."""
        return self.stages.drive.runs

    @property
    def _quantities(self) -> dict[str, Quantity]:  # type: ignore[override]
        quantity = CRITERIA[self.by].quantity
        return {self.by: quantity, "error": quantity, "margin": Quantity("margin to the next law", "1")}

    def columns(self) -> dict[str, list[Any]]:
        """Return the places of the laws."""
        names = ("rank", "law", self.by, "error", "margin", "tie", "resolved", "reason")
        return {name: [getattr(each, "value" if name == self.by else name) for each in self] for name in names}

    def plot(self) -> "Figure":
        """Draw a bar for each law, with its error."""
        from compact.report.figures import draw_rankings

        return draw_rankings({self.by: list(self)})

    def __repr__(self) -> str:
        drive, first = self.stages.drive.scene.drive.kind, self[0]
        return f"<{len(self)} laws by {CRITERIA[self.by].quantity.term}, {drive} drive; first {first.law}>"


@dataclass(frozen=True, eq=False, repr=False)
class LaboratoryTests(Tabular, Sequence[material_tests.MaterialTest]):
    """Laboratory tests, a sequence of `MaterialTest`; the table has the points of all paths, compression positive.

    Parameters
    ----------
    programme : LaboratoryProgramme
        Tests of the material.
    name : str
        Name of the material.
    """

    programme: material_tests.LaboratoryProgramme
    name: str

    @classmethod
    def of(cls, scene: Scene) -> Self:
        """Return the tests of the mix of a scene, see `Scene.laboratory_tests`."""
        return cls(material_tests.programme_of(scene), f"the mix, law {scene.mix.law}")

    def __getitem__(self, index: Any) -> Any:
        return self.programme.tests[index]

    def __len__(self) -> int:
        return len(self.programme.tests)

    def columns(self) -> dict[str, list[Any]]:
        """Return the points of all paths."""
        return {name: self.table[name] for name in self.table.quantities}

    @property
    def table(self) -> TableSpec:
        """Points of all paths, with their quantities."""
        from compact.report.laboratory import path_table

        return path_table(self, repr(self)[1:-1])

    def plot(self) -> "Figure":
        """Draw the tests, as `compact material` does."""
        from compact.report.laboratory import draw_material_tests

        return draw_material_tests(self.programme)

    def __repr__(self) -> str:
        return f"<{len(self)} laboratory tests of {self.name}>"


def laboratory_tests(material: StateUpdate, pressure: float) -> LaboratoryTests:
    """Apply the laboratory tests to loose mix of an own material.

    Parameters
    ----------
    material : StateUpdate
        Material law.
    pressure : float
        Vertical stress at the end of the oedometer and of isotropic compression [Pa], > 0.

    Returns
    -------
    LaboratoryTests
        Oedometer with unloading, isotropic compression, biaxial tests, among them the unconfined one, and pure shear;
        computed when first used.

    Raises
    ------
    ValueError
        If the material is no `StateUpdate`.
    """
    require_instance(StateUpdate, "a StateUpdate", material=material)
    return LaboratoryTests(material_tests.LaboratoryProgramme(material, None, pressure), material.name)


def roll_material(scene: Scene, material: StateUpdate, speed: float) -> Contact:
    """Compute the contact of one roller of a scene over an own material.

    Parameters
    ----------
    scene : Scene
        Scene of the engine "column" with one pass. Without a target in [contact] the pass leads to the thickness and
        the density ratio of the product.
    material : StateUpdate
        Material law, whose initial density ratio replaces that of the scene.
    speed : float
        Speed of the roller [m/s].

    Returns
    -------
    Contact

    Raises
    ------
    ValueError
        If the engine of the scene is another, or the scene has several passes or pore air.
    """
    require_instance(StateUpdate, "a StateUpdate", material=material)
    if scene.accuracy.engine != "column" or scene.layer.passes != 1:
        engine, passes = scene.accuracy.engine, scene.layer.passes
        raise ValueError(f"an own material needs the engine column and one pass, got {engine} and {passes}")
    if pore_air.has_air(scene):
        raise ValueError(f'{scene.file}: an own material has no pore air; set mix.pore_air = "drained"')
    scene = scene.replaced(**{"layer.fed_density_ratio": material.fed_density_ratio})
    case = contact_cases.case_of(scene, contact_cases.scene_mix(scene), speed)
    options, layer = {"rtol": scene.accuracy.tolerance / 10}, case.layer
    if not scene.target:
        ratio = scene.mix.density_ratio
        layer = replace(layer, height=scene.lift_thickness * ratio / material.fed_density_ratio)  # of the same grains
        options["exit_density_ratio"] = ratio
    return roll(layer, case.roller, material, speed, **options)


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
                raise ValueError(f"the law '{name}' has the {key} {value:g}, motion.{key} is {required:g}; scale it")
        found.append(law)
    return tuple(found)


class Decision(Tabular, decision.Decision):
    """One law with the sizes of its machine, as `analysis.sizing.decision.Decision`, and a table of them.

    The table has value, range (low, high) and margin of each size by its key; `other_sizes` has the alternative.

    Examples
    --------
    >>> from compact.api.scene import load_scene
    >>> found = load_scene("small").decide()
    >>> found.law, found.alternative, round(found.sizes["peak_force"].value), round(found.sizes["peak_force"].high)
    ('reversal-3', 'cubic', 3562, 5089)
    """

    _index = "quantity"
    _quantities: ClassVar = dict.fromkeys((*OF_ROW, "margin"), Quantity("", "1"))

    @classmethod
    def of(cls, scene: Scene, line: Progress) -> Self:
        """Decide for a law of a scene while a line shows the progress, see `Scene.decide`."""
        wanted = scene.replaced(**{"output.items": [*{*scene.output.items, "report"}]})  # with sources of uncertainty
        found = study.Study(wanted, line.begin, progress=line.report).decision
        if found is None:
            raise RuntimeError("no law has finite peaks by every model; give one without velocity jumps in motion.laws")
        return cls(**vars(found))

    def columns(self) -> dict[str, list[Any]]:
        """Return the sizes, a row each."""
        names = "unit", "value", "low", "high", "margin"
        found = {name: [getattr(size, name) for size in self.sizes.values()] for name in names}
        return {"quantity": list(self.sizes)} | found

    def __repr__(self) -> str:
        return f"<decision for {self.law} by {self.engine}{', or ' + self.alternative if self.alternative else ''}>"


class Study(Tabular, study.Study):
    """Results of one scene, as `analysis.study.Study`, with tables, figures and files.

    Examples
    --------
    >>> from compact.api.scene import load_scene
    >>> study = Study(load_scene("small"))
    >>> study
    <study of Small: the published machine, three laws, engine formula, 3 laws>
    >>> study.stages.drive.rankings["peak_power"][0].run.name
    'reversal-3'
    """

    _index = "law"
    _quantities: ClassVar = {name: criterion.quantity for name, criterion in CRITERIA.items()}

    def columns(self) -> dict[str, list[Any]]:
        """Return the values of all laws by each criterion of the scene, in the order of the first."""
        rankings = self.stages.drive.rankings
        values = {by: {place.run.name: place.value for place in ranked} for by, ranked in rankings.items()}
        order = [place.run.name for place in rankings[next(iter(rankings))]]
        return {"law": order} | {by: [found[name] for name in order] for by, found in values.items()}

    def plot(self) -> "Figure":
        """Draw the rankings of the laws by the criteria of the scene."""
        from compact.report.figures import draw_rankings

        return draw_rankings(self.stages.drive.places[self.scene.drive.kind])

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
        from compact.report.process import write_process

        with claimed_directory(directory, self.scene.owner, force) as place:
            return write_process(self, place)

    def __repr__(self) -> str:
        strokes = f"{self.problem.machine.strokes_on_section:.4g} strokes on a section"
        return f"<process of {self.scene.title or 'an untitled scene'}, {self.detail}, {strokes}>"
