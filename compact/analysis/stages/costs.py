"""Expected work of a study, by which its progress is measured.

Costs are seconds of processor time on one core of a machine of 2026, measured on the published machine
(studies/scenes/loveikin-2015*.toml) at the tolerance of its scene. Only their ratios matter. Those of an engine are in
`engines.EngineCost`.
"""

from collections import Counter
from dataclasses import dataclass

from compact.analysis.contact_cases import contact_speeds, hold_quantity, scene_mix
from compact.analysis.engines import ENGINES, Engine
from compact.analysis.pore_air import is_coupled
from compact.analysis.stages.laws import FOLLOWERS
from compact.machine.crankshaft import CRANK_ANGLES
from compact.material.mix import Mix
from compact.scene.loader import Scene

CONCURRENCY_FACTOR = 1.5  # [-], of contacts while other processes compute the engines of the comparison
RUN = {"rigid": 0.0025, "crank": 0.0025, "hydraulic": 0.05, "elastic": 0.017, "motor": 0.018}  # of a law, by drive
RUN_OVER_A_LAYER = {"rigid": 0.014, "crank": 0.014, "hydraulic": 0.014, "elastic": 0.035, "motor": 0.035}  # in addition
TORQUES = 3  # usual number of torques of a driven roller at each speed
OTHERS = {  # that depend neither on the engine nor on the drive
    "contact": 0.01, "kept": 0.01, "laws": 0.003, "cams": 0.0, "cams measured": 0.02, "crank": 0.03, "fields": 0.09,
    "figures": 0.35, "rankings": 0.3, "passage": 0.3, "run-up": 0.3, "uncertainty": 4.0,
}  # fmt: skip
COUPLED_CONTACTS = 2.0  # contacts that one coupled with its pore air costs; 1 to 3 on the published lift
SPREAD_CONTACTS = 5  # contacts that a spread over the laws of the mix costs
OPTIMAL_LAW = 2.0  # one optimal law
WAIT_SHARE = 0.3  # [-], of the work of another process that this one waits for
COUNTED_LATER = ("resistance", "added mass", "kept", "second pass", "passage", "run-up", "driven")  # number not known


@dataclass(frozen=True)
class WorkPlan:
    """Expected number and cost of the stages of a study.

    Parameters
    ----------
    laws_not_made : int
        Number of optimal laws that have been left out so far.
    durations : int
        Number of durations at which the laws are ranked again.
    """

    scene: Scene
    mix: Mix
    counts: Counter[str]
    laws_not_made: int = 0
    durations: int = 0

    @property
    def engine(self) -> Engine:
        """Engine of the scene."""
        return ENGINES[self.scene.accuracy.engine]

    @property
    def planned(self) -> Counter[str]:
        """Number of runs of each stage that the scene requires.

        Stages whose number is not known in advance are included as often as they have been run.
        """
        items, layered = set(self.scene.output.items), self.engine.layered
        laws = self._laws - self.laws_not_made
        rolled = 0 if self.counts["kept"] or not layered else len(self._speeds)
        fields = "fields" in items and rolled > 0
        figures = (
            3
            + 2 * ("report" in items)
            + (self.scene.drive.kind != "hydraulic")
            + (self.durations > 0)
            + len({"cams", "reactions", "crank"} & items)
            + 4 * layered
        )
        cams = laws * len(FOLLOWERS) * ("cams" in items)
        planned = Counter({
            "contact": 1, "rankings": 1, "laws": self._laws, "runs": laws * (1 + layered), "rolled": rolled,
            "fields": rolled * fields, "figures": figures * bool({"figures", "report"} & items) + fields,
            "cams": cams, "cams measured": cams, "crank": (len(CRANK_ANGLES) + 1) * ("crank" in items),
            "model spread": int("model_spread" in items and not self.counts["kept"]),
            "coupled": rolled and is_coupled(self.scene) * len(contact_speeds(self.scene)),
            "comparison": len(self.scene.compared_engines), "report": int("report" in items),
            "uncertainty": int("report" in items and self.engine.sizing),
            "durations": self.durations,
        })  # fmt: skip
        for stage in COUNTED_LATER:
            planned[stage] = self.counts[stage]
        return planned

    @property
    def total_cost(self) -> float:
        """Cost of all stages that the scene requires [s]."""
        return self._sum(self.planned | self._usual)

    @property
    def contact_cost(self) -> float:
        """Cost of contacts, resistance map and drives [s], the work of an engine of the comparison."""
        expected = self.planned | self._usual
        return self._sum({stage: expected[stage] for stage in ("rolled", "resistance", "added mass", "runs")})

    def cost(self, stage: str) -> float:
        """Return the cost of the last counted run of a stage [s]."""
        first = stage == "rolled" and self.counts[stage] == 1
        return self._usual_cost(stage) + first * self.engine.cost.first_contact

    @property
    def _laws(self) -> int:
        """Number of laws of the scene, with optimal ones."""
        optimised = self.scene.motion.optimise
        return len(self.scene.law_names) + len(self.scene.table_paths) + (len(optimised.objectives) if optimised else 0)

    @property
    def _speeds(self) -> set[float]:
        """Speeds of all contacts [m/s]: those of the scene, and the mean speed where a contact there is required."""
        required = self.engine.compacting or hold_quantity(self.scene, self.mix) is None
        return {*contact_speeds(self.scene), *([self.scene.mean_speed] if required else [])}

    @property
    def _usual(self) -> Counter[str]:
        """Usual number of runs of stages whose number is not known yet."""
        usual: Counter[str] = Counter()
        if not self.engine.layered or self.counts["kept"]:
            return usual
        rolled, cost = len(self._speeds), self.engine.cost
        if not self.counts["added mass"] and not self.counts["runs"]:
            usual["resistance"] = cost.map_speeds
        if cost.added_mass and not self.counts["runs"]:
            usual["added mass"] = rolled + max(usual["resistance"], self.counts["resistance"])
        items = self.scene.output.items
        sampled = "roller_motors" in items if self.engine.compacting else "cams" in items
        if cost.torque and sampled and not self.counts["rankings"]:
            usual["driven"] = TORQUES * rolled
        return usual

    def _usual_cost(self, stage: str) -> float:
        """Return the cost of a run of a stage that is not its first [s]."""
        scene = self.scene
        if stage == "comparison":
            others = [scene.with_engine(name) for name in scene.compared_engines]
            costs = [WorkPlan(other, scene_mix(other), Counter()).contact_cost for other in others]
            return WAIT_SHARE * sum(costs) / len(costs)
        if stage in ("runs", "durations"):
            one = RUN[scene.drive.kind] + RUN_OVER_A_LAYER[scene.drive.kind] * self.engine.layered
            return one * (self._laws if stage == "durations" else 1)
        cost = self.engine.cost
        spread = SPREAD_CONTACTS * cost.contact * (WAIT_SHARE if scene.compare else 1.0)
        by_engine = {
            "rolled": cost.contact, "resistance": cost.continued_contact, "added mass": cost.added_mass,
            "model spread": spread, "coupled": COUPLED_CONTACTS * cost.contact, "driven": cost.torque,
            "report": cost.report, "second pass": cost.second_pass,
        }  # fmt: skip
        found = by_engine[stage] if stage in by_engine else OTHERS[stage]
        if scene.compare and stage in ("rolled", "resistance"):
            found *= CONCURRENCY_FACTOR
        if stage == "laws" and scene.motion.optimise:
            found += OPTIMAL_LAW * len(scene.motion.optimise.objectives) / self._laws
        return found

    def _sum(self, expected: dict[str, int]) -> float:
        """Return the cost of stages by their number [s]."""
        first = self.engine.cost.first_contact * bool(expected["rolled"])
        return first + sum(count * self._usual_cost(stage) for stage, count in expected.items() if count)
