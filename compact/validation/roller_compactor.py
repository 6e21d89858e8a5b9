"""Cases of two rolls that compact a powder: Johanson's nip angle, distribution of pressure and peak pressure.

The mid-plane is a smooth base under half of the gap. Columns keep k h and Johanson k h cos t, so that the columns are
compared with his pressure without the second cosine, and the effect of the cosine is a number of its own.

Finite elements of half the powder above the smooth mid-plane have a nip angle of their own, where slip on the roll
ends. The powder is microcrystalline cellulose by its calibrated cap tables; it is fed without pressure, as a layer of
two thicknesses.
"""

import numpy as np

from compact.engines.column import engine as column
from compact.engines.column.roller_pair import RollerPair
from compact.engines.compaction.engine import roll
from compact.material.density_cap import density_dependent_cap
from compact.rolling_contact import Layer, Roller
from compact.validation.case import Comparison, Evaluation, Panel, ValidationCase, numbers, ours, read_rows, theirs
from compact.validation.powder import ph102

RADIUS = 0.125  # [m], of the rolls; all ratios are independent of it
EXACT = 1e-6  # [-], expected distance of integrals and distribution
NIP_PRESSURE = 1e6  # [Pa], to which all pressures are proportional
REFERENCE = ("40", "20", "5", "0.02")  # friction angles [deg], K and S/D of the figure
FEED_ANGLE = np.radians(20.0)  # [rad], assumed nip angle of the second source
ROUNDED = 0.1  # [-], of a deviation that consists of rounding
HALF_GAP = 0.0025  # [m]
FED_RATIO = 0.5  # [-], of the cap tables
FEEDS = {"thin": 0.0036, "thick": 0.0042}  # [m], halves of the fed layer, that touch beyond the nip angle
FRICTION = 0.2  # [-], of powder on roll
POWDER_SLOPE, POWDER_ANGLE = 4.0, 40.0  # [-], [deg], K of the powder by its tables, and an assumed angle of friction
NIP_EXPECTED = 0.25  # [-], of nip angles of finite elements and of Johanson; Muliadi et al. 2012, abstract
ELEMENTS_REPEAT = 1e-3  # [-], of finite elements, steady within 2e-3
COSINE_EXPECTED = 0.25  # [-], of the stress at the gap with and without the second cosine


def _pair(row: dict[str, str]) -> RollerPair:
    gap = 2 * RADIUS * float(row["gap_over_diameter"])
    angles = float(row["delta_effective_friction_deg"]), float(row["wall_friction_deg"])
    return RollerPair(RADIUS, gap, float(row["K_compressibility"]), *angles)


def _drawn(row: dict[str, str]) -> bool:
    """Return True for the friction angles of the figure."""
    return row["delta_effective_friction_deg"] in ("30", "40") and row["wall_friction_deg"] in ("10", "20")


def _johanson_rows() -> tuple[list[Comparison], dict[str, tuple[RollerPair, float]]]:
    """Compare nip angles, force factors and the distribution of columns over all rows."""
    deviations: dict[str, list[float]] = {"nip": [], "factor": [], "columns": [], "mass": []}
    pairs = {}
    cosine = {}
    for row in read_rows("johanson_nip.csv"):
        pair = _pair(row)
        nip, printed = pair.nip_angle, float(row["nip_angle_deg"])
        deviations["nip"].append(np.degrees(nip) / printed - 1)
        deviations["factor"].append(pair.force_factor(nip) / float(row["F_force_factor"]) - 1)
        found = pair.columns(NIP_PRESSURE, nip)
        angle = np.arcsin(found.x / RADIUS)
        expected = pair.relative_pressure(angle) * np.cos(angle) ** pair.compressibility
        deviations["columns"].append(float(np.abs(found.pressure / found.peak_pressure / expected - 1).max()))
        johanson = float(row["pressure_at_gap_over_at_nip"])
        without = johanson / np.cos(nip) ** pair.compressibility
        deviations["mass"].append(found.peak_pressure / NIP_PRESSURE / without - 1)
        key = row["delta_effective_friction_deg"], row["wall_friction_deg"], row["K_compressibility"]
        pairs["_".join((*key, row["gap_over_diameter"]))] = (pair, nip)
        if (*key, row["gap_over_diameter"]) == REFERENCE:
            cosine = {"ours": found.peak_pressure / NIP_PRESSURE, "theirs": johanson}
    words = {
        "nip": "nip angle",
        "factor": "force factor F",
        "columns": "pressure of columns over the peak, without the second cosine",
        "mass": "peak over nip pressure of columns, without the second cosine",
    }
    comparisons = [
        Comparison(
            name, f"{text}, largest relative deviation of {len(values)}", "-", float(np.abs(values).max()), 0.0, EXACT,
            absolute=True, repeat=ROUNDED,
        )
        for name, text in words.items()
        if (values := deviations[name])
    ]  # fmt: skip
    comparisons.append(Comparison(
        "cosine", "peak over nip pressure of columns, Johanson with his second cosine", "-", cosine["ours"],
        cosine["theirs"], COSINE_EXPECTED, note="delta 40, wall 20 degrees, K 5, S/D 0.02",
    ))  # fmt: skip
    return comparisons, pairs


def _compactor_rows() -> Comparison:
    """Compare the peak pressure of all rows of the second source."""
    deviations = []
    for row in read_rows("roller_compactor_formula.csv"):
        pair = RollerPair(0.125, 1e-3 * float(row["gap_mm"]), float(row["K_compressibility"]), 40.0, 20.0)
        factor = pair.force_factor(FEED_ANGLE)
        peak = 1e-6 * float(row["roll_force_per_width_N_per_m"]) / (pair.radius * factor)
        deviations.append(peak / float(row["peak_pressure_without_MPa"]) - 1)
    text = f"peak pressure of a roll force, largest relative deviation of {len(deviations)}"
    return Comparison("peak", text, "-", float(np.abs(deviations).max()), 0.0, EXACT, absolute=True, repeat=ROUNDED)


def _evaluate() -> Evaluation:
    comparisons, pairs = _johanson_rows()
    comparisons.append(_compactor_rows())
    pair, nip = pairs["_".join(REFERENCE)]
    found, angle = pair.columns(NIP_PRESSURE, nip), np.linspace(0, nip, 19)
    distribution = Panel(
        "angle from the gap [deg]", "pressure over the peak [-]",
        (
            ours("columns", np.degrees(np.arcsin(found.x / RADIUS)), found.pressure / found.peak_pressure),
            theirs("Johanson, with the second cosine", np.degrees(angle), pair.relative_pressure(angle)),
        ),
    )  # fmt: skip
    rows = [row for row in read_rows("johanson_nip.csv") if row["gap_over_diameter"] == "0.02"]
    rows = [row for row in rows if row["K_compressibility"] == "5" and _drawn(row)]
    compressibility = np.geomspace(2, 20, 40)
    curves = []
    for row in rows:
        angles = float(row["delta_effective_friction_deg"]), float(row["wall_friction_deg"])
        nips = [RollerPair(RADIUS, 0.02 * 2 * RADIUS, K, *angles).nip_angle for K in compressibility.tolist()]
        curves.append(ours(f"{angles[0]:g}, {angles[1]:g} degrees", compressibility, np.degrees(nips)))
    points = [row for row in read_rows("johanson_nip.csv", gap_over_diameter="0.02") if _drawn(row)]
    table = theirs("quadratures", numbers(points, "K_compressibility"), numbers(points, "nip_angle_deg"))
    nips_panel = Panel("compressibility K [-]", "nip angle [deg]", (*curves, table))
    return Evaluation(tuple(comparisons), (distribution, nips_panel))


JOHANSON = ValidationCase(
    "johanson-rolls",
    "Two rolls that compact a powder, after Johanson",
    "model",
    ("column",),
    "Johanson, J. Appl. Mech. 32 (1965) 842: the peak pressure as in github.com/martinbezecny/Virtual-Roller-"
    "Compactor, the nip equation not checked against the print; 54 and 45 points evaluated independently of this "
    "program",
    "facts only",
    "Rolls with a gap of 0.01 to 0.05 diameters, effective friction 30 to 50 degrees, wall friction 10 to 25 degrees, "
    "compressibility K 2 to 20. One roll acts on a layer of half the gap on a smooth base. No measured number was "
    "available; finite elements of the literature have nip angles within 25 % and gap stresses below Johanson's.",
    _evaluate,
    seconds=0.2,
)


def _evaluate_elements() -> Evaluation:
    """Compare finite elements of two thicknesses of the feed with Johanson and with columns at the same depth."""
    comparisons, panels, powder = [], [], density_dependent_cap(ph102(), FED_RATIO)
    for name, height in FEEDS.items():
        layer = Layer(height, base="slip")
        roller = Roller(RADIUS, height - HALF_GAP, FRICTION, "pair", "deformed")
        found = roll(layer, roller, powder, 0.1)
        columns = column.roll(layer, roller, powder, 0.1)
        pair = RollerPair(RADIUS, 2 * HALF_GAP, POWDER_SLOPE, POWDER_ANGLE, float(np.degrees(np.arctan(FRICTION))))
        nip, ahead = pair.nip_angle, f"half of the fed layer {1e3 * height:g} mm"
        angle = 0.0 if found.nip_angle is None else float(np.degrees(found.nip_angle))
        comparisons.append(Comparison(
            f"nip_{name}", f"nip angle, {ahead}", "degrees", angle, float(np.degrees(nip)), NIP_EXPECTED,
            repeat=ELEMENTS_REPEAT,
            note="presumably by the pressure of the feed, which is 0 here; a thicker feed has a larger nip angle",
        ))  # fmt: skip
        excess = max(found.peak_pressure / columns.peak_pressure - 1, 0.0)
        text = f"peak pressure above that of columns at the same depth, {ahead}"
        comparisons.append(Comparison(
            f"peak_{name}", text, "-", excess, 0.0, 0.0, absolute=True,
            note="theirs is an upper bound: stresses of finite elements are mostly below those of sections that move "
            "with the rolls",
        ))  # fmt: skip
        theory = np.linspace(0.0, nip, 30)
        panels.append(Panel(
            f"angle from the gap [deg], {ahead}", "pressure [MPa]",
            (
                ours("finite elements", np.degrees(found.x / RADIUS), 1e-6 * found.pressure),
                ours("columns", np.degrees(columns.x / RADIUS), 1e-6 * columns.pressure),
                theirs(
                    "Johanson, at the peak of the elements", np.degrees(theory),
                    1e-6 * found.peak_pressure * pair.relative_pressure(theory),
                ),
            ),
        ))  # fmt: skip
    return Evaluation(tuple(comparisons), tuple(panels))


JOHANSON_ELEMENTS = ValidationCase(
    "johanson-elements",
    "Finite elements of two rolls that compact a powder, against Johanson",
    "model",
    ("compaction", "column"),
    "Muliadi, Litster and Wassgren, Powder Technol. 221 (2012) 90, abstract: nip angles of finite elements and of "
    "Johanson agree within 25 %, his stress at the gap is mostly the larger; their tables are not available",
    "facts only",
    "Rolls of 250 mm diameter, gap 5 mm, friction 0.2, microcrystalline cellulose by the cap tables of avicel- "
    "ph102, fed at a density ratio of 0.5 without pressure, thick enough to touch the rolls beyond Johanson's nip "
    "angle. The elements compute half the layer on the smooth mid-plane; their nip angle is that at which slip of "
    "the roll over the powder ends. Johanson's powder has K = 4 by the same tables, and an assumed effective "
    "friction angle of 40 degrees.",
    _evaluate_elements,
    seconds=12.0,
)
