"""Operating window of a forming process: limits that its strokes meet, lifts shared by its points, a plant's rows.

A point of the window is a speed of the mould and a number of strokes a minute. Lumped lifts belong to the section and
its mix alone, so that all points share those of the scene: load and resistance over thickness as functions of the mean
density. A point then costs its columns.

    limit           is met where
    bite            the nip angle draws in too little mix, though the stress is below that at which mix evades
    feed            the sleeves offer too little, likewise
    heaping         the product is denser than the last lift without a growing wave, in two dimensions alone
    full density    the product is denser than the end of the measured curve
    drive           the mean power at the mean speed, or the force, exceeds what motor or cylinder can deliver
    rows            advance of the mould a stroke, or strokes a minute, are beyond those of the rows of the plant

Up to some five rows of a plant, each with a density or a force, calibrate the window. They have no more than four
unknowns: Heckel slope, pressure of extrusion, thickness that the sleeves offer where the scene has one, and their drag,

    min sum ((k - k_row)/0.005)^2 + sum (ln(F/F_row)/0.05)^2 + sum (ln(x/x_0)/spread)^2

with the values x_0 of the scene and the spreads of the prior, which decide what the rows leave open. Columns have less
resistance than the lifts, so that the values hold for the detail with which they were fitted. The advance of the mould
a stroke is the mix that a stroke has to press. Rows tell nothing of a limit that is met by a larger one only, such as
the thickness that the sleeves offer: the scene keeps the ranges of both, and points beyond are told.
"""

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from compact.analysis.calibration import with_scene_lines
from compact.analysis.contact_cases import process_detail
from compact.analysis.process import MET, MINUTE, ProcessStudy
from compact.engines.process.lifts import KnownLifts
from compact.engines.process.strokes import SEARCH_LAYERS
from compact.material.laws import MEASURED_DENSITY_RATIO
from compact.numerics import Array
from compact.scene.loader import Scene
from compact.scene.plant_data import StrokeRow

WINDOW_KEYS = frozenset({"process.mould_speed", "motion.duration"})  # on which lumped lifts do not depend
SLOPE = "mix.overrides.heckel_slope"
DIFFERENCE, TOLERANCE = 1e-2, 1e-3  # [-], of the logarithms for derivatives; of the sum, at which the fit ends
STEPS_MAX = 10  # [-], of the fit; the prior bounds what the rows leave open
DENSITY_ERROR, FORCE_ERROR = 0.005, 0.05  # [-], of a row; a core's density, and a load cell in service
PRESSURE_SPREAD, DRAG_SPREAD = 1.1, 1.0  # [-], of the logarithm; the wedge's 24 to 223 kPa, sleeves of .2 to 2.7 kN
FEED_SPREAD = 0.3  # [-], of the logarithm of the thickness that the sleeves offer in a stroke; a judgement
LINEAR_SHARE = 1 / 4  # [-], largest power of a linear torque curve over torque at rest times speed without load


def shared_lifts(scene: Scene, keys: Collection[str]) -> KnownLifts | None:
    """Return the lumped lifts of a scene for all points of a window; None if keys vary on which they depend.

    Parameters
    ----------
    scene : Scene
        Scene of the engine "process".
    keys : collection of str
        Keys that vary.
    """
    if not WINDOW_KEYS.issuperset(keys):
        return None
    return ProcessStudy(scene, process_detail(scene)).lifts


def limits_met(study: ProcessStudy) -> str:
    """Name the limits of the machine that the strokes of a process meet; empty within its operating window."""
    row, closure, history = study.row, study.closure, study.history
    if row.lifts is not None:
        steady = min(s.values("density_ratio").max() if "heaps" in s.stopped else 1.0 for s in row.lifts.sequences)
    loose = closure.kind == "extrusion_pressure" and history.peak_pressure[-1] < closure.value * (1 - MET)
    narrow = history.bite[-1] > study.problem.machine.max_bite * (1 - MET)
    force, power = deliverable(study.scene)
    needed, carts = study.moving_force, study.scene.drive.carts
    met = {
        "bite": loose and narrow,
        "feed": loose and not narrow,
        "heaping": row.lifts is not None and row.product_density_ratio > steady,
        "full density": row.product_density_ratio > MEASURED_DENSITY_RATIO,
        "rows": bool(study.beyond_rows),
        "drive": needed > force or carts * needed * study.scene.mean_speed > power,
    }
    return ", ".join(name for name, reached in met.items() if reached)


def deliverable(scene: Scene) -> tuple[float, float]:
    """Return the force on a cart [N] and the power [W] that the drive of a scene delivers at most; inf if unknown."""
    motor, oil = scene.drive.motor, scene.drive.hydraulics
    if motor is not None:
        share = LINEAR_SHARE if motor.breakdown_slip is None else 1 - motor.breakdown_slip
        return np.inf, share * motor.torque * motor.speed
    if oil is not None:
        return oil.piston_area * oil.supply_pressure, oil.pump_flow * oil.supply_pressure
    return np.inf, np.inf


class WindowFit(NamedTuple):
    """Window calibrated by the rows of a plant.

    Parameters
    ----------
    scene : Scene
        Scene with the calibrated values, without another closure than the pressure of extrusion.
    values, before : dict
        Values by key of the scene, and those of the scene that was given.
    rows : tuple of (StrokeRow, float, float)
        Rows with the computed density ratio [-] and force [N].
    """

    scene: Scene
    values: dict[str, float]
    before: dict[str, float]
    rows: tuple[tuple[StrokeRow, float, float], ...]


def calibrate_window(scene: Scene, rows: Sequence[StrokeRow]) -> WindowFit:
    """Fit Heckel slope, pressure of extrusion and drag of a process to rows of density and force.

    Parameters
    ----------
    scene : Scene
        Scene with the table [process] of a moving mould.
    rows : sequence of StrokeRow
        Rows of the plant, some five.
    """
    closed = {f"process.{name}": None for name in ("gap", "product_density_ratio")}
    layers = {"process.layers": SEARCH_LAYERS}
    study = ProcessStudy(scene.replaced(**closed), (scene.process and scene.process.detail) or "columns")
    slope, pressures = study.mix.parameter("heckel_slope"), study.extrusion_pressures
    known, before = study.lifts, {SLOPE: slope.value, "process.extrusion_pressure": pressures[0]}
    spreads = [np.log(slope.high / slope.low) / 2 or PRESSURE_SPREAD, PRESSURE_SPREAD]
    if scene.process is not None and scene.process.offered_thickness:
        before["process.offered_thickness"] = scene.process.offered_thickness
        spreads.append(FEED_SPREAD)
    if scene.sleeve is not None:
        before["sleeve.measured_drag"] = study.sleeve_drag
        spreads.append(DRAG_SPREAD)
    first = np.array([*before.values()])

    def shifted(shifts: Array) -> dict[str, float]:
        return dict(zip(before, (first * np.exp(shifts)).tolist(), strict=True))

    def at(shifts: Array, row: StrokeRow) -> ProcessStudy:
        values = shifted(shifts)
        changes: dict[str, object] = closed | layers | values | row.changes(scene.motion.dwell)
        # stresses are in proportion to 1/slope, as those of a higher rate to its factor
        lifts = known and known._replace(rate_factor=known.rate_factor * values[SLOPE] / slope.value)
        return replace(study, scene=scene.replaced(**changes), known=lifts)

    def residuals(shifts: Array) -> Array:
        found: list[Array] = [shifts / spreads]
        for row in rows:
            reached, force = reached_by(at(shifts, row))
            if row.density_ratio is not None:
                found.append(np.array([(reached - row.density_ratio) / DENSITY_ERROR]))
            if row.force is not None:
                found.append(np.log([force / row.force]) / FORCE_ERROR)
        return np.concatenate(found)

    ends, start = 3 * np.array(spreads), np.zeros(len(first))
    shifts = least_squares(residuals, start, bounds=(-ends, ends), diff_step=DIFFERENCE, ftol=TOLERANCE).x
    fitted = shifted(shifts)
    told = tuple((row, *reached_by(at(shifts, row))) for row in rows)
    return WindowFit(scene.replaced(**closed, **fitted, **measured_ranges(rows)), fitted, before, told)


def measured_ranges(rows: Sequence[StrokeRow]) -> dict[str, list[float]]:
    """Return the ranges of advances of the mould [m] and of strokes a minute [1/min] of rows, by key of the scene."""
    ranges = {
        "process.measured_advances": [MINUTE * row.mould_speed / row.strokes_per_minute for row in rows],
        "process.measured_strokes": [row.strokes_per_minute for row in rows],
    }
    return {key: [min(values), max(values)] for key, values in ranges.items()}


def reached_by(study: ProcessStudy) -> tuple[float, float]:
    """Return the density ratio of the product [-] and the force that moves a cart [N]."""
    return study.row.product_density_ratio, study.moving_force


def window_digest(found: WindowFit) -> str:
    """Describe a calibrated window in text: rows, values, and the lines for the scene."""
    lines = [f"{'mould, m/min':>12}{'strokes/min':>13}{'density ratio':>15}{'found':>8}{'force, N':>10}{'found':>8}"]
    for row, ratio, force in found.rows:
        dense, push = ("" if each is None else f"{each:.4g}" for each in (row.density_ratio, row.force))
        speed, rate = MINUTE * row.mould_speed, row.strokes_per_minute
        lines.append(f"{speed:>12.3g}{rate:>13.4g}{dense:>15}{ratio:>8.4f}{push:>10}{force:>8.0f}")
    ranges = measured_ranges([row for row, *_ in found.rows])
    words = {key: f"{value:.5g}  # measured; before {found.before[key]:.4g}" for key, value in found.values.items()}
    words |= {key: f"{ends}  # of the rows" for key, ends in ranges.items()}
    return with_scene_lines([*lines, "", "in place of process.gap or process.product_density_ratio"], words)
