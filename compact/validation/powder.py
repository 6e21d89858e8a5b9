"""Case of a compacting powder: the calibrated cap of microcrystalline cellulose in a die, and one ellipse over a range.

The tables of the cap are those of others. Their stresses in the die are rigid-plastic; ours contain elastic strain. The
engines `column` and `compaction` have the tables with the law "density-cap". An ellipse has one slope M, so that it
represents the powder over a range of density only: M, tensile strength and moduli are those at the middle, and Heckel's
line runs through both ends.
"""

from functools import cache

import numpy as np

from compact.engines.column.engine import simulate_oedometer
from compact.material.density_cap import CompressionPath, DensityCap, density_dependent_cap, heckel_slope
from compact.material.laws import Compaction
from compact.numerics import Array
from compact.validation.case import Comparison, Evaluation, Panel, ValidationCase, numbers, ours, read_rows, theirs

MPA = 1e6  # [Pa]
START, END = 0.3, 0.96  # [-], of the density ratio in the die
STRESS_EXPECTED, SLOPE_EXPECTED = 0.1, 0.02  # [-], of stresses and earth pressure, and of Heckel slopes
DENSITIES = ("0.5", "0.7", "0.9", "0.93")  # [-]
RANGES = ((0.6, 0.7), (0.7, 0.8), (0.8, 0.9))  # [-], of one ellipse
COLUMN_FED = 0.4  # [-], initial density ratio of the oedometer of columns by tables
FED_MARGIN = 0.02  # [-], of the initial density ratio below a range
STEP_REPEAT = 1e-5  # [-], of integrated paths


@cache
def ph102() -> DensityCap:
    """Return the cap of the powder."""
    cap, elastic = read_rows("ph102_cap.csv"), read_rows("ph102_elastic.csv")
    columns = (
        numbers(cap, "relative_density"), MPA * numbers(cap, "hydrostatic_yield_MPa"),
        MPA * numbers(cap, "d_cohesion_MPa"), numbers(cap, "beta_deg"), numbers(cap, "R_cap_eccentricity"),
        numbers(elastic, "relative_density"), MPA * numbers(elastic, "youngs_modulus_MPa"), numbers(elastic, "poisson"),
    )  # fmt: skip
    return DensityCap(*(tuple(column.tolist()) for column in columns))


def ellipse_of_range(low: float, high: float) -> Compaction:
    """Return the law of `column` for a range of density ratios [-], by the tables at its middle and ends.

    Parameters
    ----------
    low, high : float
        Ends of the range of the density ratio [-].

    Returns
    -------
    Compaction
    """
    cap, middle = ph102(), (low + high) / 2
    centre, eccentricity, *_ = cap.cap(middle)
    pressures = np.interp((low, middle, high), cap.density_ratio, cap.yield_pressure)
    slope = np.log((1 - low) / (1 - high)) / (pressures[2] - pressures[0])
    bulk, shear = cap.elastic_moduli(middle)
    poisson = (3 * bulk - 2 * shear) / (6 * bulk + 2 * shear)
    return Compaction(
        unloading_modulus=2 * shear * (1 + poisson),
        poisson=poisson,
        heckel_slope=float(slope),
        loose_density_ratio=float(1 - (1 - low) * np.exp(slope * pressures[0])),
        critical_slope=1 / eccentricity,
        tensile_strength=float(pressures[1] - 2 * centre),
        fed_density_ratio=low - FED_MARGIN,
    )


def _die_rows(path: CompressionPath) -> list[Comparison]:
    """Compare axial stress and ratio of radial to axial stress with the table."""
    found = []
    for density in DENSITIES:
        row = read_rows("ph102_cap.csv", relative_density=density)[0]
        axial = float(path.at(float(density)))
        ratio = float(path.at(float(density), "radial_stress")) / axial
        for name, words, unit, value, column in (
            ("axial", "axial stress in the die", "MPa", axial / MPA, "oedometer_axial_MPa"),
            ("ratio", "radial over axial stress", "-", ratio, "radial_over_axial"),
        ):
            found.append(Comparison(
                f"{name}_{density}", f"{words} at density ratio {density}", unit, value, float(row[column]),
                STRESS_EXPECTED, repeat=STEP_REPEAT,
            ))  # fmt: skip
    return found


def _slope_rows(die: CompressionPath, isotropic: CompressionPath) -> list[Comparison]:
    """Compare the ratio of the Heckel slopes of isotropic compression and of the die."""
    table, found = numbers(read_rows("ph102_cap.csv"), "relative_density"), []
    for row in read_rows("ph102_heckel.csv"):
        low, high = float(row["from_RD"]), float(row["to_RD"])
        density = table[(table >= low) & (table <= high)]
        slopes = heckel_slope(density, isotropic.at(density)), heckel_slope(density, die.at(density))
        found.append(Comparison(
            f"slopes_{low:g}_{high:g}", f"isotropic over die Heckel slope, {low:g} to {high:g}", "-",
            slopes[0] / slopes[1], float(row["slope_ratio"]), SLOPE_EXPECTED, repeat=STEP_REPEAT,
        ))  # fmt: skip
    return found


def _column_rows() -> list[Comparison]:
    """Compare the oedometer of `column` by the tables with the table."""
    stress = np.linspace(0.002, 1.2, 240) * float(ph102().rigid_die(float(DENSITIES[-1])).axial_stress[0])
    test = simulate_oedometer(density_dependent_cap(ph102(), COLUMN_FED), stress)
    found = []
    for density in DENSITIES:
        row = read_rows("ph102_cap.csv", relative_density=density)[0]
        axial = float(np.interp(float(density), test.density_ratio, test.pressure))
        ratio = float(np.interp(float(density), test.density_ratio, test.lateral_stress)) / axial
        for name, words, unit, value, column in (
            ("axial", "axial stress of columns by tables", "MPa", axial / MPA, "oedometer_axial_MPa"),
            ("ratio", "radial over axial stress of columns by tables", "-", ratio, "radial_over_axial"),
        ):
            found.append(Comparison(
                f"columns_{name}_{density}", f"{words} at density ratio {density}", unit, value, float(row[column]),
                STRESS_EXPECTED, repeat=STEP_REPEAT,
            ))  # fmt: skip
    return found


def _ellipse_stress(low: float, high: float, density: Array) -> Array:
    """Return the axial stress [Pa] of `column` with one ellipse at density ratios [-]."""
    law, cap = ellipse_of_range(low, high), ph102()
    largest = float(cap.rigid_die(high).axial_stress[0])
    stress = np.linspace(0.01, 1.4, 140) * largest
    test = simulate_oedometer(law, stress)
    return np.interp(density, test.density_ratio, test.pressure)


def _ellipse_rows() -> list[Comparison]:
    """Compare the oedometer of `column` with the die at the ends of each range."""
    found = []
    for low, high in RANGES:
        for density in (low, high):
            stress = float(_ellipse_stress(low, high, np.array([density]))[0])
            exact = float(ph102().rigid_die(density).axial_stress[0])
            found.append(Comparison(
                f"ellipse_{low:g}_{high:g}_at_{density:g}",
                f"axial stress of one ellipse for {low:g} to {high:g}, at {density:g}", "MPa", stress / MPA,
                exact / MPA, STRESS_EXPECTED, basis="fitted: Heckel's line through the isotropic yield at both ends",
                repeat=STEP_REPEAT,
            ))  # fmt: skip
    return found


def _evaluate() -> Evaluation:
    cap = ph102()
    die, isotropic = cap.die(START, END), cap.isotropic(START, END)
    rows = [row for row in read_rows("ph102_cap.csv") if float(row["relative_density"]) <= END]
    density = numbers(rows, "relative_density")
    stresses = Panel(
        "density ratio [-]", "stress [MPa]",
        (
            ours("axial, die", die.density_ratio, die.axial_stress / MPA),
            ours("radial, die", die.density_ratio, die.radial_stress / MPA),
            ours("isotropic", isotropic.density_ratio, isotropic.axial_stress / MPA),
            theirs("", density, numbers(rows, "oedometer_axial_MPa")),
            theirs("", density, numbers(rows, "oedometer_radial_MPa")),
            theirs("", density, numbers(rows, "hydrostatic_yield_MPa")),
        ),
        log_y=True,
    )  # fmt: skip
    used = die.density_ratio > 0.4
    ratio = Panel(
        "density ratio [-]", "radial over axial stress [-]",
        (
            ours("die, elastic-plastic", die.density_ratio[used], die.radial_stress[used] / die.axial_stress[used]),
            theirs("rigid-plastic", density, numbers(rows, "radial_over_axial")),
        ),
    )  # fmt: skip
    curves = []
    for low, high in RANGES:
        k = np.linspace(low - FED_MARGIN / 2, high + FED_MARGIN / 2, 40)
        curves.append(ours(f"{low:g} to {high:g}", k, _ellipse_stress(low, high, k) / MPA))
    inner = (density >= RANGES[0][0]) & (density <= RANGES[-1][1])
    table = theirs("table", density[inner], numbers(rows, "oedometer_axial_MPa")[inner])
    ellipses = Panel("density ratio [-]", "axial stress of one ellipse [MPa]", (*curves, table))
    comparisons = (*_die_rows(die), *_slope_rows(die, isotropic), *_column_rows(), *_ellipse_rows())
    return Evaluation(comparisons, (stresses, ratio, ellipses))


PH102 = ValidationCase(
    "avicel-ph102",
    "Microcrystalline cellulose in a die, by a cap over density",
    "calibration",
    ("column",),
    "cap and elastic tables of Avicel PH102 in github.com/taha-re/manuscript-data-density-dependent-friction-"
    "tableting, commit 83e1922, credited there to the group of Cunningham and Zavaliangos; rigid-plastic die by us",
    "no licence file; facts only",
    "The modified Drucker-Prager cap with tables over the density ratio, from 0.3 on: stresses in a die without wall "
    "friction, earth pressure, and the ratio of the Heckel slopes of isotropic compression and die. The tables are "
    "inputs; nothing is fitted to the stresses in the die. The table at density ratio 0.4 is out of line with its "
    "neighbours. The engine column has the tables by the law density-cap, fed at 0.4, and an ellipse with one slope M, "
    "which is compared over ranges of 0.1 in density.",
    _evaluate,
    seconds=1.0,
)
