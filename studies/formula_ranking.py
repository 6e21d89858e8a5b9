"""Ranking of the motion laws over the spread of the mix, by the engineering formulas.

The required pressure of the mix is known within a factor of 1.5, and the resistance is nearly proportional to its
square. The laws are ranked at the low end, the expected value and the high end of the spread. Limits: equations
1.1-1.10, a resistance independent of speed, a rigid drive.
"""

from pathlib import Path

from compact.analysis.study import Study
from compact.report.progress import tracked
from compact.scene.loader import load_scene

SCENES = Path(__file__).parents[1] / "compact" / "data" / "scenes"


def main(scene="loveikin-2015", by="peak_power", **overrides):
    """Return (end of the spread, resistance of a cart [N], laws in order) for each required pressure."""
    nominal = load_scene(SCENES / f"{scene}.toml", **{"output.items": [], "drive.rank_by": [by], **overrides})
    pressure = Study(nominal).stages.contacts.mix.parameter("required_pressure")
    rows = []
    for end in tracked(("low", "value", "high"), "end of the spread"):
        study = Study(nominal.replaced(**{"mix.overrides.required_pressure": getattr(pressure, end)}))
        order = [(place.rank, place.run.name) for place in study.stages.drive.rankings[by]]
        rows.append((end, study.stages.resistance.steady_law.force, order))
    return rows


if __name__ == "__main__":
    for scene in ("loveikin-2015", "loveikin-2015-crank"):
        print(scene)
        for end, force, order in main(scene):
            print(f"  {end:<6}{force:8.0f} N  " + ", ".join(f"{rank} {name}" for rank, name in order[:5]))
