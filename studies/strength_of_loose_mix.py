"""Strength of loose mix: one pass of the published lift by both yield surfaces, cohesions and feeds on three meshes.

A lift of 0.06 m is rolled 3 mm deep by incremental rolling at a constant depth, on a coarse mesh from rest and on finer
ones from the state of the coarser one. A pass counts as steady if load and resistance change by less than 0.5 % and the
bow wave by less than 2 % over the last two contact lengths. Otherwise the mix heaps up, and the travel is stated.

    python studies/strength_of_loose_mix.py [--increments 6 12 24] [--out out/strength-of-loose-mix]
"""

import argparse
import csv
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from threadpoolctl import threadpool_limits

from compact.engines.compaction.roller_frame import transfer_state
from compact.engines.compaction.rolling import DAMPING, FINAL_DAMPING_RATIO, IncrementalRolling
from compact.engines.compaction.rolling_case import RollingCase, RollingNumerics
from compact.files import write_figure
from compact.material.laws import Compaction, cap_slope, drucker_prager_cap
from compact.rolling_contact import Layer, Roller

RADIUS, DEPTH, LIFT, LENGTH = 0.11, 0.003, 0.06, 1.164  # [m], roller, depth, compacted lift, roller length
FED, EXIT = 0.935763, 0.98  # [-], density ratios of the published lift
ANGLE, COHESION, PRESSURE = 35.0, 10e3, 200e3  # [deg], [Pa], [Pa] at which K0 holds
LARGEST_WAVE = 0.02  # [m], of the bow wave, beyond which a pass ends
TOLERANCE = 1e-3  # [-], residual of a step
STEADY_FORCES, STEADY_WAVE, STEADY_SPAN = 5e-3, 2e-2, 2.0  # [-], of a steady pass; span in contact lengths
COMMON = {"unloading_modulus": 120e6, "poisson": 0.3, "heckel_slope": 14.96e-6, "loose_density_ratio": 0.72}


@dataclass(frozen=True)
class Case:
    """Mix of one series of meshes, with the travel [m] on the first mesh and on finer ones."""

    name: str
    material: Compaction
    travel: float
    finer: float


@dataclass(frozen=True)
class Pass:
    """State of a pass: load and resistance of the whole roller [N], bow wave [m], travel [m], time [s]."""

    case: str
    increments: int
    load: float
    resistance: float
    bow_wave: float
    travel: float
    steady: bool
    seconds: float


def line(fed: float = FED, cohesion: float = COHESION, viscosity: float = 0.0, dilatancy: float = 0.0) -> Compaction:
    """Return the Drucker-Prager cap with Jaky's earth pressure coefficient."""
    return drucker_prager_cap(
        friction_angle=ANGLE,
        cohesion=cohesion,
        earth_pressure_coefficient=1 - float(np.sin(np.radians(ANGLE))),
        pressure=PRESSURE,
        dilatancy_angle=dilatancy,
        fed_density_ratio=fed,
        shear_viscosity=viscosity,
        **COMMON,
    )


def ellipse(fed: float = FED, slope: float | None = None) -> Compaction:
    """Return the elliptic cap with a flat subcritical side, by default with M of the friction angle."""
    return Compaction(
        **COMMON,
        critical_slope=float(np.sqrt(3) * np.sin(np.radians(ANGLE))) if slope is None else slope,
        tensile_strength=float(COHESION / np.tan(np.radians(ANGLE))),
        fed_density_ratio=fed,
        heckel_test="confined",
    )


def cases() -> Iterator[Case]:
    """Yield the mixes of the study."""
    strength = float(COHESION / np.tan(np.radians(ANGLE)))
    slope = cap_slope(1 - float(np.sin(np.radians(ANGLE))), PRESSURE, strength)
    yield Case("ellipse", ellipse(), 2.5, 0.6)
    yield Case("ellipse, fed 0.90", ellipse(0.90), 0.5, 0.25)
    yield Case("K0 cap, flat", ellipse(slope=slope), 0.5, 0.25)
    yield Case("line, c 20 kPa", line(cohesion=20e3), 0.5, 0.25)
    yield Case("line, fed 0.90", line(0.90), 0.5, 0.25)
    yield Case("line, fed 0.90, S 600", line(0.90, viscosity=600.0), 0.5, 0.25)
    yield Case("line, fed 0.92, S 600", line(0.92, viscosity=600.0), 1.0, 0.3)
    yield Case("line, S 600", line(viscosity=600.0), 2.2, 0.35)
    yield Case("line", line(), 2.2, 0.35)
    yield Case("line, dilatancy 10", line(dilatancy=10.0), 1.0, 0.2)


def roll_on(case: Case, increments: int, coarse: IncrementalRolling | None) -> tuple[Pass, IncrementalRolling]:
    """Roll on one mesh, from rest or from the state on a coarser one."""
    height = LIFT * EXIT / case.material.fed_density_ratio
    roller = Roller(RADIUS, indentation=DEPTH, friction=0.35, rolling="free", profile="deformed")
    rolling_case = RollingCase(Layer(height), roller, case.material, 0.133, None, None, RollingNumerics())
    rolling = rolling_case.roller_at_rest(rolling_case.create_frame(DEPTH, increments))
    rolling.solver.tolerance, start = TOLERANCE, time.process_time()
    end = case.travel
    if coarse is None:
        for share in np.linspace(0, 1, 2 * increments + 1)[1:]:
            rolling.advance(height - share * DEPTH, DAMPING)
    else:
        rolling.initialise_from(coarse, transfer_state(coarse.state, coarse.frame, rolling.frame))
        end = rolling.steps[-1].travel + case.finer
    while rolling.steps[-1].travel < end and rolling.steps[-1].bow_wave < LARGEST_WAVE:
        rolling.advance(height - DEPTH, FINAL_DAMPING_RATIO * DAMPING)
    steps = rolling.steps[-max(int(STEADY_SPAN * increments), 2) :]
    table = np.array([[step.load, step.resistance, step.bow_wave] for step in steps])
    spread = np.ptp(table, axis=0) / np.abs(table).max(axis=0)
    mean_load, mean_resistance, _ = table[len(table) // 2 :].mean(axis=0) * LENGTH
    steady = bool(spread[:2].max() < STEADY_FORCES and (spread[2] < STEADY_WAVE or table[-1, 2] < 0.2e-3))
    found = Pass(
        case.name, increments, float(mean_load), float(mean_resistance), steps[-1].bow_wave, steps[-1].travel, steady,
        time.process_time() - start,
    )  # fmt: skip
    return found, rolling


def main(increments: Sequence[int] = (6, 12), names: Sequence[str] = (), out: Path | str = "out") -> list[Pass]:
    """Roll every case on every mesh, print the table and write it as CSV."""
    found: list[Pass] = []
    with threadpool_limits(1):
        for case in cases():
            if names and case.name not in names:
                continue
            rolling = None
            for count in increments:
                try:
                    result, rolling = roll_on(case, count, rolling)
                except RuntimeError as error:
                    print(f"{case.name}, {count} increments: {error}", flush=True)
                    break
                found.append(result)
                print(row(result), flush=True)
                if result.bow_wave >= LARGEST_WAVE:
                    break
    path = Path(out) / "strength-of-loose-mix.csv"
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(Pass.__dataclass_fields__)
        writer.writerows(vars(each).values() for each in found)
    write_figure(path.with_suffix(".png"), draw(found))
    return found


def draw(passes: Sequence[Pass]) -> Figure:
    """Draw coefficient and bow wave of each case, one mark for each mesh; hollow marks are not steady."""
    from compact.report.figures import PALETTE

    names = list(dict.fromkeys(each.case for each in passes))
    figure = Figure(figsize=(9.0, 0.8 + 0.32 * len(names)), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    meshes = sorted({each.increments for each in passes})
    for colour, mesh in zip(PALETTE, meshes, strict=False):
        for each in passes:
            if each.increments == mesh:
                mark = {"color": colour, "marker": "o", "markerfacecolor": colour if each.steady else "none"}
                left.plot(each.resistance / each.load, names.index(each.case), **mark)
                right.plot(1e3 * each.bow_wave, names.index(each.case), **mark)
        right.plot([], [], "o", color=colour, label=f"{mesh} elements per contact length")
    left.set(xlabel="rolling-resistance coefficient [-]", yticks=range(len(names)), yticklabels=names)
    left.invert_yaxis()
    right.set(xlabel="bow wave [mm]; hollow: not steady")
    right.legend(frameon=False, fontsize=8)
    return figure


def row(result: Pass) -> str:
    """Return one line of the table."""
    state = "steady" if result.steady else f"unsteady after {result.travel:.2f} m"
    return (
        f"| {result.case} | {result.increments} | {result.load:.0f} | {result.resistance:.0f} | "
        f"{result.resistance / result.load:.4f} | {1e3 * result.bow_wave:.2f} | {state} | {result.seconds:.0f} s |"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--increments", type=int, nargs="+", default=[6, 12])
    parser.add_argument("--names", nargs="*", default=[])
    parser.add_argument("--out", default="out/strength-of-loose-mix")
    options = parser.parse_args()
    main(options.increments, options.names, options.out)
