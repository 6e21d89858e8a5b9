"""Ranking of the published machine at its printed speed with and without pore air, by both laws of the mix.

    python studies/ranking_with_air.py
    python studies/ranking_with_air.py --mixes "cap, columns" ellipse

The machine has a rigid drive and 0.889 s a stroke, 0.45 m/s. The lift is that of `pore_air`: 0.06 m thick and 3 mm
deep, without an effect of the rate, so that only the air depends on the speed. The shear line with the published
cohesion of 10 kPa heaps up at the published initial density ratio. It is computed with 20 kPa there, and with 10 kPa at
0.90, where both are steady. Columns have no bow wave and use the published cohesion.

Coupled contacts use 1e-11 m2, a permeability above the prior: within it the lift has no steady state at 0.45 m/s.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from time import process_time

from compact.analysis.study import Study
from compact.scene.loader import load_scene

SCENE = Path(__file__).parents[1] / "compact" / "data" / "scenes" / "loveikin-2015.toml"
SPEEDS = [0.11, 0.45, 0.9]  # [m/s]
COMMON = {
    "motion.duration": 0.889, "contact.speeds": SPEEDS, "contact.indentation": 3.0e-3, "layer.lift_thickness": 0.06,
    "layer.fed_density_ratio": 0.936, "mix.overrides.heckel_slope": 1.487e-5, "mix.overrides.rate_sensitivity": 0.0,
    "output.items": [], "accuracy.engine": "compaction",
}  # fmt: skip
LINE = {"mix.law": "drucker-prager-cap"}
LOOSE = {"layer.fed_density_ratio": 0.90, "contact.indentation": 5.3e-3}
COLUMNS = {"accuracy.engine": "column"}
MIXES = {
    "ellipse": {},
    "cap, 20 kPa": LINE | {"mix.overrides.cohesion_loose": 20e3},
    "cap, 10 kPa, fed 0.90": LINE | LOOSE,
    "ellipse, columns": COLUMNS,
    "cap, columns": LINE | COLUMNS,
}
AIRS = {
    "drained": {},
    "one-way, 1e-12 m2": {"mix.pore_air": "one-way", "mix.overrides.air_permeability": 1e-12},
    "one-way, 1e-13 m2": {"mix.pore_air": "one-way", "mix.overrides.air_permeability": 1e-13},
    "coupled, 1e-11 m2": {"mix.pore_air": "coupled", "mix.overrides.air_permeability": 1e-11},
}
CRITERIA = ("peak_force", "peak_power")
SHOWN = 2  # [-], laws of each criterion
HEADER = ("mix", "pore air", "resistance, N/m", "peak force, N", "peak power, W")


def rows(mixes: list[str], airs: list[str]) -> Iterator[tuple[str, ...]]:
    """Yield rows of HEADER; columns have no coupled contact."""
    for mix in mixes:
        for air in airs:
            if air.startswith("coupled") and mix.endswith("columns"):
                continue
            yield mix, air, *answer(COMMON | MIXES[mix] | AIRS[air])


def answer(changes: dict[str, object]) -> tuple[str, str, str]:
    """Return the resistances and the first laws by both criteria; the reason where the contact is not steady."""
    study = Study(load_scene(SCENE, **{"drive.turn": "step"} | changes))  # the air on the force far from a turn
    try:
        resistances = ", ".join(f"{each.resistance:.0f}" for each in study.stages.contacts.records)
        return resistances, *(first_laws(study, criterion) for criterion in CRITERIA)
    except RuntimeError as error:
        return str(error), "", ""


def first_laws(study: Study, criterion: str) -> str:
    """Return the first laws by a criterion with their values, and where the first two tie."""
    found = study.stages.drive.rankings[criterion][:SHOWN]
    return ", ".join(f"{each.run.name} {each.value:.0f}" for each in found) + (" (a tie)" if found[0].tie else "")


def main(arguments: list[str] | None = None) -> None:
    """Parse the command line and print the table of `docs/which_law.md`."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mixes", nargs="+", choices=list(MIXES), default=list(MIXES), help="mixes and engines")
    parser.add_argument("--airs", nargs="+", choices=list(AIRS), default=list(AIRS), help="kinds of pore air")
    given = parser.parse_args(arguments)
    print("| " + " | ".join(HEADER) + " |\n" + "|---" * len(HEADER) + "|")
    start = process_time()
    for row in rows(given.mixes, given.airs):
        print("| " + " | ".join(row) + " |", flush=True)
    print(f"\n{process_time() - start:.0f} s of processor time")


if __name__ == "__main__":
    main()
