"""Study of one scene, from the contact to the ranking of the motion laws.

    study = Study(load_scene("scene.toml"))
    study.rankings["peak_force"]

A study is a pipeline of stages: contacts, resistance, laws, drives, comparison of engines. Each result is computed when
first used, and the runs of each stage are counted. `report.writer` writes the results; `compact run` does both.
"""

import warnings
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any

from compact.analysis.contact_cases import ContactRecord, HeldQuantity, scene_mix
from compact.analysis.engineering_summary import Engineering, Number
from compact.analysis.engines import Engine
from compact.analysis.ranking_uncertainty import Place
from compact.analysis.stages import comparison
from compact.analysis.stages.comparison import (
    ComparisonRequest,
    EngineComparison,
    Places,
    RankingAgreement,
    ranking_agreements,
    run_engine_alternative,
)
from compact.analysis.stages.contacts import Count, Passes, Progress, no_count
from compact.analysis.stages.costs import WorkPlan
from compact.analysis.stages.kept_results import KeptResults, write_results
from compact.analysis.stages.pipeline import build_stages
from compact.analysis.stages.sensitivity import Shift, sensitivities
from compact.analysis.worker_pool import BackgroundTasks, SerialExecutor
from compact.cams.profile import Cam
from compact.contact import DryResistance
from compact.engines.halfplane import LineContact
from compact.machine.cart import Balance, Cart
from compact.machine.crankshaft import CrankshaftRevolution
from compact.machine.ranking import Ranked
from compact.machine.roller_motors import RollerMotor
from compact.material.mix import Mix
from compact.motion.profile import Cycle
from compact.resistance import ResistanceMap
from compact.rolling_contact import ContactResult
from compact.scene.loader import Scene


class Study:
    """Results of one scene; each attribute is computed when first used.

    The attributes are those of the stages `contact_stage`, `resistance_stage`, `law_stage` and `drive_stage`.

    Parameters
    ----------
    step : callable
        Called with the name of each stage that begins.
    directory : Path, optional
        Results of an earlier run, whose contacts and resistance map are used if they have the same key.
    progress : callable, optional
        Called with lines of text by engines with continuation.

    Attributes
    ----------
    counts : Counter
        Number of runs of each stage.
    """

    def __init__(
        self,
        scene: Scene,
        step: Count = no_count,
        directory: Path | None = None,
        progress: Progress | None = None,
    ) -> None:
        self.scene, self.counts = scene, Counter[str]()
        self._step, self._directory = step, directory
        self._answers: dict[str, Any] | None = None
        self._background: BackgroundTasks | None = None
        self.mix: Mix = scene_mix(scene)
        self.stages = build_stages(scene, self.mix, self.count, directory, progress)
        self.prescribed_laws, self.contact_stage = self.stages.prescribed, self.stages.contacts
        self.resistance_stage, self.law_stage = self.stages.resistance, self.stages.laws
        self.drive_stage = self.stages.drive

    def count(self, stage: str) -> None:
        """Count one run of a stage."""
        self.counts[stage] += 1
        self._step(stage)
        if self._background:
            self._background.poll()

    # progress

    @property
    def plan(self) -> WorkPlan:
        """Expected work of all results that the scene requires."""
        return WorkPlan(self.scene, self.mix, self.counts, self.law_stage.number_not_made)

    # contact stage

    @property
    def engine(self) -> Engine:
        """Engine of the scene."""
        return self.contact_stage.engine

    @property
    def layered(self) -> bool:
        """True if the engine has a layer of finite height."""
        return self.engine.layered

    @property
    def engineering(self) -> Engineering:
        """Eqs 1.1-1.10 at the prescribed pressure, or at the pressure that the density requires."""
        return self.contact_stage.engineering

    @property
    def exact(self) -> LineContact:
        """Galin's exact contact at the peak pressure of the formulas."""
        return self.contact_stage.exact

    @property
    def numbers(self) -> dict[str, Number]:
        """Results of the formulas and of the exact theory by name."""
        return self.contact_stage.numbers

    @property
    def contacts(self) -> list[ContactRecord]:
        """Scalar results of one roller at each speed; empty for the formulas."""
        return self.contact_stage.records

    @property
    def held(self) -> HeldQuantity | None:
        """Quantity that is constant over speed; None for the formulas."""
        return self.contact_stage.held

    @property
    def passes(self) -> list[tuple[float, Passes]]:
        """Speed [m/s] and results of all passes at each speed; empty for the formulas."""
        return self.contact_stage.passes

    def passes_at(self, speed: float) -> Passes:
        """Compute all passes at a speed [m/s]."""
        return self.contact_stage.passes_at(speed)

    @property
    def rolled(self) -> list[tuple[float, ContactResult]]:
        """Speed [m/s] and result of the first pass at each speed."""
        return self.contact_stage.first_passes

    @property
    def fields(self) -> list[tuple[Any, ContactResult]]:
        """Mesh with fields, and result, at each speed."""
        return self.contact_stage.fields

    @property
    def roller_load(self) -> float:
        """Load of one roller [N]: of the engine at the mean speed, or by eq 1.6."""
        return self.contact_stage.roller_load

    @property
    def second_pass(self) -> tuple[float, float] | None:
        """Load and resistance of a second pass over those of the first [-]; None for a linear layer."""
        return self.contact_stage.second_pass

    @property
    def key(self) -> str:
        """Hash of all inputs of the contacts and the resistance map."""
        return self.contact_stage.key

    @property
    def kept(self) -> KeptResults | None:
        """Results of an earlier run in the directory."""
        return self.contact_stage.kept

    def standing(self, directory: Path, *prefixes: str) -> list[Path]:
        """Return the valid files of an earlier run with any of the prefixes; none if a prefix has no file."""
        kept = self.kept.files if self.kept else ()
        if not all(any(file.startswith(prefix) for file in kept) for prefix in prefixes):
            return []
        return [directory / file for file in kept if file.startswith(prefixes)]

    def keep(self, directory: Path, files: list[Path]) -> Iterator[Path]:
        """Write contacts and resistance map for the next run, with the names of their files; yield the paths."""
        before = self.kept.files if self.kept else ()
        names = sorted({*before, *(file.relative_to(directory).as_posix() for file in files)})
        if self.held is None:
            return
        results = KeptResults(self.contacts, self.held, self.second_pass, self.resistance_map, tuple(names))
        yield from write_results(directory, results, self.key)

    # resistance stage

    @property
    def resistance(self) -> ResistanceMap | DryResistance:
        """Resistance of the mix to one cart [N], a function of velocity and acceleration."""
        return self.resistance_stage.resistance

    @property
    def resistance_map(self) -> ResistanceMap:
        """Resistance of one cart by a layered engine."""
        return self.resistance_stage.map

    @property
    def resistance_error(self) -> float | None:
        """Relative error estimate of the resistance [-]; None if unknown."""
        return self.resistance_stage.error

    @property
    def fastest(self) -> float:
        """Speed up to which the resistance is known [m/s]."""
        return self.resistance_stage.largest_speed

    @property
    def cart(self) -> Cart:
        """Cart with the reactions of its rollers."""
        return self.resistance_stage.cart

    @property
    def steady(self) -> Balance:
        """Forces on the cart at constant mean speed, arrays of shape (1,)."""
        return self.resistance_stage.steady

    # law stage

    @property
    def cycles(self) -> dict[str, Cycle]:
        """Forward and return strokes by name of the law: prescribed laws, tables of the user, optimal laws."""
        return self.law_stage.cycles

    @property
    def optimal_cycles(self) -> dict[str, Cycle]:
        """Forward and return strokes of the optimal laws by name."""
        return self.law_stage.optimal_cycles

    @property
    def laws_not_made(self) -> dict[str, str]:
        """Reason by name of each optimal law that is left out of `cycles`."""
        return self.law_stage.not_made

    @property
    def cams(self) -> dict[tuple[str, str], Cam]:
        """Cams of constant breadth by law and follower."""
        return self.law_stage.cams

    # drive stage

    @property
    def runs(self) -> dict[str, Any]:
        """A `Run`, `ElasticRun`, `HydraulicRun` or `MotorRun` by name of the law."""
        return self.drive_stage.runs

    @property
    def heavier_runs(self) -> dict[str, Any] | None:
        """Runs under the resistance plus its error; None without error estimate."""
        return self.drive_stage.heavier_runs

    @property
    def rankings(self) -> dict[str, list[Ranked]]:
        """Laws in order, by each criterion of the scene."""
        return self.drive_stage.rankings

    @property
    def places(self) -> dict[str, dict[str, list[Place]]]:
        """Places of the laws by drive and criterion."""
        return self.drive_stage.places

    @property
    def cycle_energies(self) -> dict[str, float]:
        """Energy of a cycle [J] over "fresh" and "compacted" mix; empty without a second pass."""
        return self.drive_stage.cycle_energies

    @property
    def roller_motors(self) -> dict[str, RollerMotor]:
        """Motors in the rollers by name of the law."""
        return self.drive_stage.roller_motors

    @property
    def turns(self) -> dict[str, CrankshaftRevolution]:
        """One turn of the crankshaft with 1 to 4 carts, and under "scene" that of the scene."""
        return self.drive_stage.turns

    @cached_property
    def sensitivities(self) -> list[Shift]:
        """Sensitivity of the least peaks to each input, with a rigid drive."""
        return sensitivities(self.stages)

    # comparison

    @contextmanager
    def helped(self, executor: Any) -> Iterator[None]:
        """Run the engines of the comparison by an executor of `worker_pool` while this process computes its part."""
        directory = self._directory and self._directory / comparison.DIRECTORY
        with BackgroundTasks(executor) as tasks:
            self._answers = {}
            for name in self.scene.compared_engines:
                request = ComparisonRequest(
                    self.scene.with_engine(name),
                    self.prescribed_laws.cycles,
                    self.cycles,
                    directory and directory / name,
                )
                self._answers[name] = tasks.submit(name, run_engine_alternative, request)
            self._background = tasks
            try:
                yield
            finally:
                self._background = None

    @cached_property
    def comparison(self) -> dict[str, EngineComparison]:
        """Results of each engine of the comparison by name."""
        if self._answers is None:
            with self.helped(SerialExecutor()):
                return self.comparison
        found = {}
        for name, answer in self._answers.items():
            self.count("comparison")
            found[name] = answer()
            for words in found[name].warned:
                warnings.warn(f"{name}: {words}", stacklevel=2)
        return found

    @property
    def places_by_engine(self) -> dict[str, Places]:
        """Places by engine, drive and criterion; engine and drive of the scene first."""
        return {self.scene.accuracy.engine: self.places} | {name: each.places for name, each in self.comparison.items()}

    @cached_property
    def agreements(self) -> list[RankingAgreement]:
        """Agreement of the ranking of the scene with those of the other engines and of its other drive."""
        return ranking_agreements(self.places_by_engine)
