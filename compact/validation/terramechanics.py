"""Cases of published soils: Bekker's wheels by exact integrals, and the model of Wong and Reece.

Both verify the integrals of `engines.column.rigid_wheel`; neither contains a measured number.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from compact.engines.column.rigid_wheel import WheelContactResult, parabola_sinkage, roll_wheel, textbook_wheel
from compact.material.pressure_sinkage import PeakAngle, PowerSinkage, ShearStrength, Terrain
from compact.rolling_contact import Layer, Roller
from compact.validation.case import Comparison, Evaluation, Panel, ValidationCase, numbers, ours, read_rows, theirs

DEEP = Layer(10.0)  # [m], of which laws over the sinkage are independent
SPEED = 1.0  # [m/s], of which the wheels are independent
EXACT, MODEL = 1e-9, 1e-6  # [-], expected distances from exact integrals and from the model
TEXTBOOK = 0.1  # [-], expected error of closed forms
ROUNDED = 0.1  # [-], of a deviation that consists of the rounding of nine digits
CURVE_SLIPS = np.linspace(0.02, 0.8, 40)  # [-]


def _bekker() -> Evaluation:
    """Compare sinkage and compaction resistance of five wheels, and the closed forms of the textbook."""
    comparisons = []
    rows = read_rows("bekker_wheels.csv")
    for row in rows:
        soil, width, radius = row["soil"], float(row["width_m"]), float(row["radius_m"])
        law, load = PowerSinkage(float(row["k_Pa_per_m_n"]), float(row["n"])), float(row["load_N"]) / width
        found = roll_wheel(DEEP, Roller(radius, load=load), Terrain(law), SPEED)
        exact, resistance = float(row["sinkage_exact_m"]), float(row["compaction_resistance_exact_N"])
        simple, simple_resistance = textbook_wheel(law, radius, load)
        for name, unit, value, reference, expected in (
            ("sinkage", "m", found.indentation, exact, EXACT),
            ("compaction resistance", "N", found.compaction_resistance * width, resistance, EXACT),
            ("sinkage by a parabola", "m", parabola_sinkage(law, radius, load), exact, TEXTBOOK),
            ("sinkage by the textbook form", "m", simple, exact, TEXTBOOK),
            ("resistance by the textbook form", "N", simple_resistance * width, resistance, TEXTBOOK),
        ):
            key = f"{soil} {name}".lower().replace(" ", "_")
            comparisons.append(Comparison(key, f"{name}, {soil}", unit, value, reference, expected))
    errors = [100 * numbers(rows, f"{name}_textbook_over_exact_less_1") for name in ("sinkage", "resistance")]
    exponents = numbers(rows, "n")
    panel = Panel(
        "exponent n [-]", "error of the textbook forms [%]",
        (theirs("sinkage", exponents, errors[0]), theirs("resistance", exponents, errors[1])),
    )  # fmt: skip
    return Evaluation(tuple(comparisons), (panel,))


BEKKER = ValidationCase(
    "bekker-wheels",
    "Rigid wheels on Bekker's soils",
    "exact",
    ("column",),
    "soils as public code carries them from Wong, Theory of Ground Vehicles, 2008; integrals by quadrature over the "
    "horizontal and over the angle with 25 digits, independent of this program",
    "facts only; quadratures for this validation",
    "Five wheels of 0.25 to 0.7 m radius under 500 to 6000 N on published soils, n 0.11 to 1.1: sinkage and compaction "
    "resistance of columns under a circle without shear. The closed forms of the textbook are compared with the same "
    "integrals, which shows their error.",
    _bekker,
    seconds=0.05,
)


def _wheel(row: Mapping[str, str], inputs: Mapping[str, str], **motion: float) -> WheelContactResult:
    """Compute one wheel of the table; lengths in m, forces per unit width."""
    law = PowerSinkage(float(inputs["k_Pa_per_m_n"]), float(inputs["n"]))
    shear = ShearStrength(float(inputs["c_Pa"]), float(inputs["phi_deg"]), float(inputs["K_m"]))
    terrain = Terrain(law, shear, PeakAngle(float(inputs["c1"]), float(inputs["c2"])))
    load = float(row["load_N"]) / float(inputs["width_m"])
    return roll_wheel(DEEP, Roller(float(inputs["radius_m"]), load=load), terrain, SPEED, **motion)


def rim_slip(row: Mapping[str, str]) -> dict[str, float]:
    """Return the slip of a row as a keyword; the skid of the source is travel over rim speed less one."""
    value = float(row["slip_or_skid"])
    if row["motion"] == "driven":
        return {"slip": value}
    return {"slip": -value / (1 + value)} if row["motion"] == "towed" else {}


QUANTITIES: Sequence[tuple[str, str, Callable[[WheelContactResult, float], float]]] = (
    ("entry angle", "entry_angle_deg", lambda found, _: float(np.degrees(found.entry_angle))),
    ("angle of the largest stress", "angle_of_peak_stress_deg", lambda found, _: np.degrees(found.peak_angle)),
    ("sinkage", "geometric_sinkage_mm", lambda found, _: 1e3 * found.indentation),
    ("drawbar", "drawbar_N", lambda found, width: found.drawbar * width),
    ("torque", "torque_N_m", lambda found, width: found.torque * width),
    ("peak stress", "peak_normal_stress_kPa", lambda found, _: found.peak_pressure / 1e3),
)  # words, column and value of ours at a width [m]


def _wong_reece() -> Evaluation:
    """Compare all rows of the table: the row with the largest deviation of each quantity, and the free skids."""
    comparisons, found = [], []
    inputs = {row["soil_and_wheel"]: row for row in read_rows("wong_reece_inputs.csv")}
    for row in read_rows("wong_reece_model.csv"):
        given = inputs[row["soil_and_wheel"]]
        wheel = _wheel(row, given, **rim_slip(row))
        found.append((row, wheel, float(given["width_m"])))
        if "free" in row["motion"]:
            skid, key = -wheel.slip / (1 + wheel.slip), row["soil_and_wheel"].replace(" ", "_")
            text = f"skid without torque, {row['soil_and_wheel']}"
            comparisons.append(Comparison(f"skid_{key}", text, "-", skid, float(row["slip_or_skid"]), MODEL))
    for words, column, value in QUANTITIES:
        rows = [(value(wheel, width), float(row[column]), row) for row, wheel, width in found]
        usable = [each for each in rows if not (column == "torque_N_m" and "free" in each[2]["motion"])]
        worst = max(abs(value / reference - 1) for value, reference, _ in usable)
        text = f"{words}, largest relative deviation of {len(usable)}"
        comparisons.append(Comparison(column, text, "-", float(worst), 0.0, MODEL, absolute=True, repeat=ROUNDED))
    return Evaluation(tuple(comparisons), (_drawbar_panel(inputs, found),))


def _drawbar_panel(
    inputs: Mapping[str, Mapping[str, str]], found: Sequence[tuple[Mapping[str, str], WheelContactResult, float]]
) -> Panel:
    """Draw the drawbar of driven wheels over the slip."""
    curves, points = [], []
    for name, given in inputs.items():
        rows = [(row, wheel) for row, wheel, _ in found if row["soil_and_wheel"] == name and row["motion"] == "driven"]
        width, load = float(given["width_m"]), float(rows[0][0]["load_N"])
        line = [_wheel(rows[0][0], given, slip=slip).drawbar * width / load for slip in CURVE_SLIPS.tolist()]
        curves.append(ours(name, CURVE_SLIPS, line))
        table = [row for row, _ in rows]
        points.append(theirs("", numbers(table, "slip_or_skid"), numbers(table, "drawbar_N") / load))
    return Panel("slip [-]", "drawbar over load [-]", (*curves, *points))


WONG_REECE = ValidationCase(
    "wong-reece",
    "Driven and towed wheels by the model of Wong and Reece",
    "model",
    ("column",),
    "constants of Table 1 of Wong and Reece, J. Terramech. 4 (1967), as in github.com/jcmadsen/pyTerramechanics, "
    "commit 0966497; integrals by adaptive quadrature, independent of this program",
    "BSD-3-Clause (constants)",
    "Rigid wheels of 49.4 in diameter on compact and loose sand under about 9 kN: stress by Reece's law ahead of its "
    "largest value and mirrored behind, shear stress by Janosi and Hanamoto. The skids are travel over rim speed less "
    "one. No measured value of the source was available as a number, so that the case verifies the integrals only.",
    _wong_reece,
    seconds=0.8,
)
