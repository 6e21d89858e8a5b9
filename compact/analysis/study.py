"""Study of one scene, from the contact to the ranking of the motion laws.

    study = Study(load_scene("scene.toml"))
    study.stages.drive.rankings["peak_force"]

A study is a pipeline of stages: contacts, resistance, laws, drives, comparison of engines. Each result is computed when
first used, and the runs of each stage are counted. `report.writer` writes the results; `compact run` does both.
"""

import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from compact.analysis import machine_models
from compact.analysis.contact_cases import Progress
from compact.analysis.pore_air import AirAnswer, air_answer
from compact.analysis.sizing.balances import BalanceCheck, WorkBalance, balance_checks, work_balance
from compact.analysis.sizing.decision import Choice, candidates, choose, decide
from compact.analysis.sizing.durations import DurationStudy, over_durations, require_durations
from compact.analysis.sizing.machine_sizing import MachineSizing, machine_sizing
from compact.analysis.stages import drives, kept_results, verdict
from compact.analysis.stages.contacts import Count, no_count
from compact.analysis.stages.laws import CamDrawing
from compact.analysis.stages.uncertainty import RankingUncertainty, ranking_uncertainty
from compact.analysis.worker_pool import Executor, Job, SerialExecutor
from compact.files import results_key
from compact.scene.loader import Scene


class Study:
    """Results of one scene; each attribute is computed when first used.

    The stages are `stages.contacts`, `stages.resistance`, `stages.laws` and `stages.drive`.

    Parameters
    ----------
    step : callable
        Called with the name of each stage that begins.
    directory : Path, optional
        Results of an earlier run, whose contacts and resistance map are used if they have the same key.
    progress : callable, optional
        Called with lines of text by engines with continuation.
    durations : sequence of float
        Durations of a pass at which the laws are ranked again [s], ascending.

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
        durations: Sequence[float] = (),
    ) -> None:
        require_durations(scene, durations)
        machine_models.catalogue(scene)  # mistakes in it are reported before anything is computed
        self.scene, self.counts, self.durations = scene, Counter[str](), tuple(durations)
        self._step, self._directory = step, directory
        self.executor: Executor = SerialExecutor()
        shortest = min(self.durations, default=None)
        self.stages = drives.build_stages(scene, self.count, directory, progress, shortest=shortest)
        self.stages.contacts.submit = self.submit

    def count(self, stage: str) -> None:
        """Count one run of a stage."""
        self.counts[stage] += 1
        self._step(stage)

    def standing(self, directory: Path, *prefixes: str) -> list[Path]:
        """Return the valid files of an earlier run with any of the prefixes; none if a prefix has no file."""
        before = self.stages.contacts.kept
        kept = before.files if before else ()
        if not all(any(file.startswith(prefix) for file in kept) for prefix in prefixes):
            return []
        return [directory / file for file in kept if file.startswith(prefixes)]

    def keep(self, directory: Path, files: list[Path]) -> Iterator[Path]:
        """Write contacts and resistance map for the next run, with the names of their files; yield the paths."""
        contacts, resistance = self.stages.contacts, self.stages.resistance
        if contacts.held is None:
            return
        found = contacts.kept or kept_results.KeptResults(
            contacts.key, contacts.records, contacts.held, contacts.second_pass, resistance.map, contacts.air_curve
        )
        names = {*found.files, *(file.relative_to(directory).as_posix() for file in files)}
        found = replace(
            found, resistance_map=resistance.map, files=tuple(sorted(names)),
            lifts=contacts.process.lifts if contacts.process else None,
            model_spread=self.__dict__.get("model_spread", found.model_spread),
            prior=self.__dict__.get("_prior", found.prior),
            uncertainty={self._key: known} if (known := self.__dict__.get("uncertainty")) else found.uncertainty,
        )  # fmt: skip
        yield from kept_results.write_results(directory, found)

    @cached_property
    def pore_air(self) -> AirAnswer | None:
        """Numbers on the pore air; None for a linear layer, and for mix that is occluded as fed."""
        curve = self.stages.contacts.air_curve
        return None if curve is None else air_answer(curve, self.stages.contacts.mix, self.scene.mean_speed)

    @property
    def sizing_peaks(self) -> list[str]:
        """Criteria of the verdict that the scene ranks by."""
        return [by for by in verdict.SIZING_PEAKS if by in self.scene.drive.rank_by]

    @property
    def case(self) -> tuple[float, str]:
        """Duration of a pass [s] and kind of drive of the scene."""
        return self.scene.motion.duration, self.scene.drive.kind

    @cached_property
    def nominal_verdicts(self) -> dict[str, verdict.Verdict]:
        """Verdicts by criterion without the sources of uncertainty; absent where no law has a finite value."""
        return {by: each for by in self.sizing_peaks if (each := verdict.verdict(self.models, *self.case, by))}

    @cached_property
    def models(self) -> list[verdict.ModelAnswer]:
        """Answers of the engine of the scene, first, and of the engines of the comparison."""
        spread = self.model_spread
        own = verdict.model_answer(self.stages, spread.resistance if spread else None, self._prior)
        return [own, *self.comparison.values()]

    @cached_property
    def _prior(self) -> tuple[float, float] | None:
        """Load on a roller and resistance of a cart with nothing fitted [N]; None without a fit."""
        kept = self.stages.contacts.kept
        return kept.prior if kept else self._prior_job.result()

    @cached_property
    def _prior_job(self) -> Job:
        return self.submit(partial(verdict.prior_forces, self.scene), self.scene)

    @cached_property
    def uncertainty(self) -> RankingUncertainty | None:
        """Effect of every source of uncertainty on the recommended laws.

        None without the output "report", without a model that is valid for sizing, and where no law has a finite value.
        """
        wanted = "report" in self.scene.output.items and any(each.valid for each in self.models)
        if not (wanted and self.nominal_verdicts):
            return None
        kept = self.stages.contacts.kept
        if kept and kept.uncertainty and (known := kept.uncertainty.get(self._key)):
            return known
        self.count("uncertainty")
        return ranking_uncertainty(self)

    @property
    def _key(self) -> str:
        """Hash of all inputs of the study and of the peaks of all models, under which its uncertainty is kept."""
        peaks = [each.values(*self.case, by) for each in self.models for by in self.sizing_peaks]
        return results_key(self.scene.hash, self.scene.known_origins, self.durations, peaks)

    @cached_property
    def candidates(self) -> tuple[str, ...]:
        """Laws of which one is decided."""
        named = [*(each.law for each in self.nominal_verdicts.values()), *self.stages.laws.robust]
        peaks = self.sizing_peaks
        return candidates(self.models, self.case, peaks, self.stages.laws.cycles, named) if peaks else ()

    @cached_property
    def choice(self) -> Choice | None:
        """Decided law and alternative; None where no law has finite peaks."""
        return choose(self.models, self.case, self.candidates, self.sizing_peaks, self.uncertainty)

    decision = cached_property(decide)

    @cached_property
    def verdicts(self) -> dict[tuple[float, str, str], verdict.Verdict]:
        """Verdicts by duration [s], drive and criterion; absent where no law has a finite value.

        Those of the duration and drive of the scene include the spread of the mix and of its laws.
        """
        found = {}
        for duration, drive in ((each, kind) for each, places in self.models[0].places.items() for kind in places):
            for by in self.sizing_peaks:
                firsts = self.uncertainty.first_laws(by) if self.case == (duration, drive) and self.uncertainty else ()
                if each := verdict.verdict(self.models, duration, drive, by, firsts):
                    found[duration, drive, by] = each
        return found

    @property
    def governing(self) -> list[verdict.Governing]:
        """Pass over fresh mix and forming process at the duration and drive of the scene, the larger of which sizes."""
        verdicts = [each for key, each in self.verdicts.items() if key[:2] == self.case]
        found = verdict.governing(verdict.governing_pair(self.models), verdicts, self.scene.motion.duration)
        return [*found, *self.machine_sizing.compared.values()]

    @cached_property
    def machine_sizing(self) -> MachineSizing:
        """Motor of every law, and guide wheels and bearings under the decided law.

        Where a pass over fresh mix and the forming process both size the machine, each is that of the larger one.
        """
        law, pair = self.choice.law if self.choice else None, verdict.governing_pair(self.models)
        return machine_sizing(self.stages, law, pair)

    @cached_property
    def work_balance(self) -> WorkBalance:
        """Balances of work and mix under the first law."""
        return work_balance(self.stages)

    @cached_property
    def over_durations(self) -> DurationStudy | None:
        """Ranking over the duration; None without durations."""
        return over_durations(self.stages, self.durations) if self.durations else None

    @property
    def best_laws(self) -> list[str]:
        """Three laws: the decided one, the alternative, and the next candidate or the next in the ranking."""
        ranked = [place.run.name for ranks in self.stages.drive.rankings.values() for place in ranks[:3]]
        own = [self.choice.law, self.choice.alternative, *self.choice.candidates] if self.choice else []
        return list(dict.fromkeys([law for law in (*own, *ranked) if law]))[:3]

    @cached_property
    def checks(self) -> list[BalanceCheck]:
        """Balances of all results."""
        return balance_checks(self.stages)

    @cached_property
    def first_cam(self) -> CamDrawing | None:
        """Drawing of the cam of the decided law; None for a scene without the output "cams"."""
        law = self.choice.law if self.choice else self.stages.drive.best_law
        return self.stages.laws.drawing(law) if "cams" in self.scene.output.items else None

    # comparison

    @contextmanager
    def helped(self, executor: Executor) -> Iterator[None]:
        """Run the engines of the comparison by an executor of `worker_pool` while this process computes its part."""
        with executor:
            self.executor = executor
            _ = self._answers
            try:
                yield
            finally:
                self.executor = SerialExecutor()

    def submit(self, work: Callable[[Any], Any], task: Any) -> Job:
        """Start a task by the executor of `helped`; without one it runs in this process when it is waited for."""
        return self.executor.submit(work, task)

    @cached_property
    def _answers(self) -> dict[str, Job]:
        """Jobs of the engines of the comparison by name."""
        laws = self.stages.laws.prescribed, self.stages.laws.cycles
        directory = self._directory and self._directory / verdict.DIRECTORY
        return {
            name: self.submit(
                partial(verdict.answer_of, self.scene, self.scene.with_engine(name), laws),
                directory and directory / name,
            )
            for name in self.scene.compared_engines
        }

    @cached_property
    def _answers_by_law(self) -> list[Job]:
        """Jobs of the contacts by the other laws of the mix; none where they are not required, or kept."""
        contacts = self.stages.contacts
        kept = contacts.kept and contacts.kept.model_spread
        if kept or not contacts.compacts or "model_spread" not in self.scene.output.items:
            return []
        assert contacts.held is not None  # of a compacting engine
        work = partial(verdict.contact_by_law, contacts.held)
        return [self.submit(work, each) for each in verdict.scenes_of_laws(self.scene, contacts.mix)]

    def begin_contacts(self) -> None:
        """Start the second pass, and the contacts by the other laws of the mix, where required and not kept."""
        _ = self.stages.contacts.second_job, self._answers_by_law
        if "report" in self.scene.output.items and not self.stages.contacts.kept:
            _ = self._prior_job

    @cached_property
    def model_spread(self) -> verdict.ModelSpread | None:
        """Contacts by the other laws of the mix; None where they are not required."""
        if self._answers_by_law:
            self.count("model spread")
            return verdict.spread_of([job.result() for job in self._answers_by_law])
        kept = self.stages.contacts.kept
        return kept.model_spread if kept and "model_spread" in self.scene.output.items else None

    @property
    def comparison(self) -> dict[str, verdict.ModelAnswer]:
        """Answer of each engine of the comparison by name, but of those without a steady state."""
        return {name: each for name, each in self._compared.items() if isinstance(each, verdict.ModelAnswer)}

    @property
    def failures(self) -> dict[str, Exception]:
        """Errors of the other engines of the comparison by name: no steady state, or no equilibrium."""
        return {name: each for name, each in self._compared.items() if isinstance(each, Exception)}

    @cached_property
    def _compared(self) -> dict[str, verdict.Answer]:
        """Results of each engine of the comparison by name."""
        found = {}
        for name, job in self._answers.items():
            self.count("comparison")
            found[name] = job.result()
            for words in getattr(found[name], "warned", ()):
                warnings.warn(f"{name}: {words}", stacklevel=2)
        return found

    @property
    def places_by_engine(self) -> dict[str, drives.Places]:
        """Places by engine, drive and criterion; engine and drive of the scene first."""
        return {self.scene.accuracy.engine: self.stages.drive.places} | {
            name: each.places[self.scene.motion.duration] for name, each in self.comparison.items()
        }
