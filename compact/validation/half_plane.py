"""Case of a relaxing half-plane: the output of the program CONTACT for two cylinders of PA6, and the resistance.

Two like bodies in contact are one half-plane of half the stiffness under a rigid roller,

    E* = E/(1 - nu^2),  E = 2 (G/2)(1 + nu)

with the shear modulus G of each body and the combined radius. A body with the creep time T under constant stress and
moduli G, 2 G has the relaxation time T/2. The half-plane is a layer of many contact lengths. The layer must also be
thick over the travel within one relaxation time, 0.45 m at 100 m/s.
"""

import numpy as np

from compact.engines.fem import engine as fem
from compact.engines.halfplane import hertz
from compact.engines.spectral import engine as spectral
from compact.material.laws import Elastic, Viscoelastic
from compact.rolling_contact import ContactResult, Layer, Roller
from compact.validation.case import Comparison, Evaluation, Panel, ValidationCase, numbers, ours, read_rows, theirs

PRINTED_UNIT = 0.01  # [MPa], of the last printed digit of the peak pressure
SPECTRAL_EXPECTED, FEM_EXPECTED = 1e-4, 5e-3  # [-], of the resistance
LAYER_HEIGHT = {"spectral": 1e4, "fem": 10.0}  # [m]
SERIES_CREEP_TIME = 0.009  # [s], of the resistance over speed
FEM_REPEAT = 1e-4  # [-], the iteration of the contact ends at 1e-8 of the load; the resistance is a small share of it
FIGURE_POINTS = 41  # [-], speeds of the curve of `spectral`
PLACES = {"spectral": spectral, "fem": fem}


def _roll(engine: str, modulus: float, creep_time: float, speed: float, row: dict[str, str]) -> ContactResult:
    """Compute one contact by an engine; without a creep time the half-plane is elastic."""
    poisson = float(row["poisson"])
    material = (
        Viscoelastic(modulus, poisson, branches=((1.0, creep_time / 2),)) if creep_time else Elastic(modulus, poisson)
    )
    roller = Roller(float(row["combined_radius_m"]), load=1e3 * float(row["line_load_N_per_mm"]))
    options = {"estimate": False} if engine == "fem" else {}
    return PLACES[engine].roll(Layer(LAYER_HEIGHT[engine]), roller, material, speed, **options)


def relaxed_modulus(row: dict[str, str]) -> float:
    """Return Young's modulus [Pa] of the half-plane that stands for both bodies, relaxed or elastic."""
    shear_modulus = 1e6 * float(row["G_instant_MPa_each_body"]) / 2
    if row["creep_time_s"] != "elastic":
        shear_modulus /= 2  # two like springs in series with the dashpot
    return 2 * shear_modulus * (1 + float(row["poisson"]))


def cells_in_contact(result: ContactResult, cell: float) -> tuple[int, int]:
    """Return the number of cells [-] of a size [m] that the contact covers in part or whole, at the front and rear."""
    return int(np.ceil(result.leading / cell)), int(np.ceil(-result.trailing / cell))


def _printed_rows() -> list[Comparison]:
    """Compare peak pressure and contact length with the printed table."""
    found = []
    for row in read_rows("contact_pa6.csv"):
        time = 0.0 if row["creep_time_s"] == "elastic" else float(row["creep_time_s"])
        elastic = row["creep_time_s"] == "elastic"
        if elastic and row["case"] == "5":  # the same as the first
            continue
        name = "elastic, instant modulus" if elastic else f"creep time {time:g} s"
        key = "elastic" if elastic else f"creep_{time:g}"
        result = _roll("spectral", relaxed_modulus(row), time, float(row["speed_m_s"]), row)
        exact = ""
        if elastic:
            modulus = Elastic(relaxed_modulus(row), float(row["poisson"])).contact_modulus
            line = hertz(radius=float(row["combined_radius_m"]), contact_modulus=modulus, load=result.load)
            exact = f"Hertz's formula gives {line.peak_pressure / 1e6:.4f} MPa; the difference is that of their grid"
        found.append(Comparison(
            f"{key}_peak", f"peak pressure, {name}", "MPa", result.peak_pressure / 1e6,
            float(row["peak_pressure_MPa"]), PRINTED_UNIT, PRINTED_UNIT / 2, absolute=True, explanation=exact,
        ))  # fmt: skip
        cell, length = float(row["cell_mm"]), float(row["contact_length_mm"])
        front, rear = cells_in_contact(result, 1e-3 * cell)
        counted = (front + rear) * cell
        counts = ""
        if abs(counted - length) < cell / 2:
            counts = f"our edges lie in {front} + {rear} of their cells, which are the printed {length:g} mm"
        found.append(Comparison(
            f"{key}_length", f"contact length, {name}", "mm", 1e3 * (result.leading - result.trailing), length, cell,
            2 * cell, absolute=True, explanation=counts,
        ))  # fmt: skip
    return found


def _evaluate() -> Evaluation:
    comparisons = _printed_rows()
    row = read_rows("contact_pa6.csv", creep_time_s=f"{SERIES_CREEP_TIME:g}")[0]
    series = read_rows("pa6_over_speed.csv")
    speeds, expected = numbers(series, "speed_m_s"), numbers(series, "resistance_over_load")
    changes = numbers(series, "change_from_400_to_800_cells")
    lines = []
    for engine, limit in (("spectral", SPECTRAL_EXPECTED), ("fem", FEM_EXPECTED)):
        values = []
        for speed, value, change in zip(speeds.tolist(), expected.tolist(), changes.tolist(), strict=True):
            result = _roll(engine, relaxed_modulus(row), SERIES_CREEP_TIME, speed, row)
            ratio = float(result.resistance / result.load)
            values.append(ratio)
            cause = ""
            if abs(ratio - value) < change:
                slow = SERIES_CREEP_TIME / 2 * speed / float(row["combined_radius_m"])
                cause = (
                    f"the reference changes by {change:.1g} from 400 to 800 cells, more than the difference of "
                    f"{abs(ratio - value):.1g}; the limit of slow rolling, tau v/R, is {slow:.3g}"
                )
            comparisons.append(Comparison(
                f"{engine}_{speed:g}", f"resistance over load by {engine} at {speed:g} m/s", "-", ratio, value, limit,
                change, explanation=cause, repeat=FEM_REPEAT if engine == "fem" else 1e-6,
            ))  # fmt: skip
        lines.append(ours(engine, speeds, values))
    between = np.geomspace(speeds[0], speeds[-1], FIGURE_POINTS)
    modulus = relaxed_modulus(row)
    fine = [_roll("spectral", modulus, SERIES_CREEP_TIME, speed, row) for speed in between.tolist()]
    lines[0] = ours("spectral", between, [each.resistance / each.load for each in fine])
    panel = Panel(
        "speed [m/s]", "resistance over load [-]", (*lines, theirs("collocation", speeds, expected)), log_x=True
    )
    return Evaluation(tuple(comparisons), (panel,))


PA6 = ValidationCase(
    "contact-pa6",
    "Relaxing half-plane: the program CONTACT on cylinders of PA6",
    "program",
    ("spectral", "fem"),
    "Vollebregt and Kalker, CONTACT, example visc_cylindr, printed output, after Wang and Knothe, J. Appl. Mech. 60 "
    "(1993) 310; github.com/eve70a/CONTACT, commit d431cdb. The resistance over speed is not printed there: it is a "
    "third calculation, by collocation with half-planes and without code of either program",
    "Apache-2.0",
    "Two cylinders of radius 100 mm under 600 N/mm at 1 m/s, Poisson's ratio 0.4, shear modulus 1143 MPa at first and "
    "571.5 MPa in the end. One half-plane of half their stiffness replaces both; nothing is fitted. Their contact "
    "length is a whole number of cells of 0.16 mm.",
    _evaluate,
    seconds=3.0,
)
