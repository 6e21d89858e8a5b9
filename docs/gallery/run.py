"""Run the studies of the gallery, and require that each one ends well and writes its figure.

    python docs/gallery/run.py              # all studies, an hour
    python docs/gallery/run.py --fast       # the fast half, three minutes at most
    python docs/gallery/run.py rank_laws    # some of them

Each study is a process of its own and writes below the folder `--out`: its figures, and what it prints. The pages show
copies of these, which `--update` replaces.
"""

import argparse
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

PAGES = Path(__file__).parent
ROOT = PAGES.parents[1]


@dataclass(frozen=True)
class Run:
    """Command line of a study, and the figure of its page.

    Parameters
    ----------
    figure : str
        File below the folder of the results; empty if the page shows the printed table.
    arguments : tuple of str
        Options of the command line.
    fast : bool
        Whether the study takes less than half a minute of processor time.
    """

    figure: str
    arguments: tuple[str, ...] = ()
    fast: bool = False


RUNS = {
    "compaction_baseline": Run("", ("--reference", "7"), fast=True),
    "density_after_passes": Run("out/density_after_passes/density_after_passes.png"),
    "duration": Run("out/duration/duration.png"),
    "elastic_drive": Run("out/elastic_drive/elastic_drive.png", fast=True),
    "formula_against_fem": Run("out/formula_against_fem/formula_against_fem.png", fast=True),
    "formula_ranking": Run("", fast=True),
    "hard_cases": Run("out/hard_cases/hard_cases.png", fast=True),
    "moisture_density": Run("out/moisture_density/moisture_density.png", fast=True),
    "motor_and_flywheel": Run("out/motor_and_flywheel/motor_and_flywheel.png", fast=True),
    "open_codes": Run("", ("--markdown",), fast=True),
    "operating_point": Run("out/operating_point/operating_point.png"),
    "optimal_laws": Run("out/optimal_laws/optimal_laws.png", fast=True),
    "pore_air": Run("out/pore_air.png", ("--increments", "7", "--out", "out"), fast=True),
    "random_lifts": Run(""),
    "rank_laws": Run("out/rank_laws/rank_laws.png"),
    "ranking_with_air": Run("", ("--mixes", "ellipse, columns", "cap, columns"), fast=True),
    "return_stroke": Run("out/return_stroke/return_stroke.png"),
    "reversal": Run(""),
    "robust_law": Run(""),
    "speed_against_error": Run("out/speed_against_error/layers.png"),
    "speed_against_plain": Run(""),
    "speed_dependence": Run("out/speed_dependence/speed_dependence.png"),
    "strength_of_loose_mix": Run("out/strength-of-loose-mix/strength-of-loose-mix.png", ("--increments", "6")),
    "turning_and_drive": Run("", fast=True),
}


def processor_time() -> float:
    """Return the processor time of the ended child processes [s]."""
    times = os.times()
    return times.children_user + times.children_system


def run(name: str, folder: Path) -> str:
    """Run one study in a folder of its own; return the reason of a failure, or an empty string."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    command = [sys.executable, str(ROOT / "studies" / f"{name}.py"), *RUNS[name].arguments]
    path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    environment = os.environ | {"PYTHONPATH": path}
    with (folder / "printed.txt").open("w", encoding="utf-8") as printed:
        done = subprocess.run(
            command,
            cwd=folder,
            stdout=printed,
            stderr=subprocess.PIPE,
            text=True,
            env=environment,
        )
    if done.returncode:
        return f"exit code {done.returncode}: {done.stderr.strip().splitlines()[-1:]}"
    shown = folder / (RUNS[name].figure or "printed.txt")
    return "" if shown.is_file() and shown.stat().st_size else f"{shown} is missing or empty"


def update(name: str, folder: Path) -> None:
    """Copy the figure or the printed table of a study to its page."""
    figure = RUNS[name].figure
    source = folder / (figure or "printed.txt")
    shutil.copy(source, PAGES / "results" / f"{name}{source.suffix}")


def main(arguments: list[str] | None = None) -> int:
    """Run the studies of the command line; return 1 if one of them fails."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("names", nargs="*", metavar="STUDY", help=f"some of {', '.join(RUNS)}")
    parser.add_argument("--fast", action="store_true", help="the fast half")
    parser.add_argument("--out", type=Path, default=Path("out/gallery"), help="folder of the results")
    parser.add_argument("--update", action="store_true", help="copy figures and tables to the pages")
    options = parser.parse_args(arguments)
    names = options.names or [name for name, each in RUNS.items() if each.fast or not options.fast]
    if unknown := sorted(set(names) - set(RUNS)):
        parser.error(f"no study {', '.join(unknown)}; choose from {', '.join(RUNS)}")
    failed = 0
    for name in names:
        before = processor_time()
        reason = run(name, options.out.resolve() / name)
        print(f"{name:<24}{processor_time() - before:8.1f} s  {reason or 'ok'}", flush=True)
        failed += bool(reason)
        if options.update and not reason:
            update(name, options.out.resolve() / name)
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
