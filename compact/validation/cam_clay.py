"""Case of Cam-clay numbers: earth pressure at rest of the ellipse, and one step of another program.

The ellipse of `compaction` and `column` is that of modified Cam-clay with a tensile strength, hardened along Heckel's
curve instead of a line in ln p. Rigid-plastic compression without lateral strain has one ratio of stresses for each M,
which does not depend on the hardening. The step of the other program has its own elasticity and hardening, so that its
stress is held to the ellipse at its own preconsolidation pressure.
"""

import numpy as np

from compact.material import cap_plasticity
from compact.material.laws import Compaction
from compact.validation.case import Comparison, Evaluation, Panel, ValidationCase, ours, read_rows, theirs

RIGID_MODULUS = 1e13  # [Pa], some 1e8 times the pressure
STRAIN, STEPS = 0.3, 50  # [-], logarithmic, of the compression, and its increments
EXPECTED = 1e-6  # [-]
PROGRAM_SLOPE = 1.2  # [-], M of the step
K0_PREFIX = "K0 of the Cam-clay ellipse"
CURVE_SLOPES = np.linspace(0.7, 1.7, 11)  # [-]


def earth_pressure_at_rest(slope: float) -> float:
    """Compute lateral over vertical stress of nearly rigid mix in confined compression.

    Parameters
    ----------
    slope : float
        M of the ellipse [-].

    Returns
    -------
    float
        K0 [-].
    """
    mix = Compaction(
        unloading_modulus=RIGID_MODULUS, poisson=0.3, heckel_slope=10e-6, loose_density_ratio=0.5, critical_slope=slope,
        tensile_strength=0.0, fed_density_ratio=0.6, dry_side="ellipse",
    )  # fmt: skip
    state, increment = cap_plasticity.initial_state(mix, 1), np.array([[0.0, -STRAIN / STEPS, 0.0]])
    for _ in range(STEPS):
        state, _ = cap_plasticity.integrate_points(mix, state, increment, tangent=False)
    return float(state.stress[0, 0] / state.stress[0, 1])


def _program_row(values: dict[str, float]) -> Comparison:
    """Compare the von Mises stress of the other program with that of the ellipse at its mean pressure."""
    x, y, z = (-values[f"cb-geo: stress {name}"] for name in ("xx after the step", "yy", "zz"))
    p, pc = (x + y + z) / 3, values["cb-geo: pc after the step"]
    q = np.sqrt(((x - y) ** 2 + (y - z) ** 2 + (z - x) ** 2) / 2)
    value = float(PROGRAM_SLOPE * np.sqrt(p * (pc - p)))
    return Comparison(
        "cb_geo",
        "von Mises stress of the ellipse, at p and pc of a step of cb-geo/mpm",
        "Pa",
        value,
        float(q),
        EXPECTED,
    )


def _evaluate() -> Evaluation:
    rows = read_rows("cam_clay_numbers.csv")
    values = {row["quantity"]: float(row["value"]) for row in rows}
    known = {
        float(name.split("M=")[1]): value for name, value in values.items() if name.startswith(K0_PREFIX)
    }  # by slope
    comparisons = [
        Comparison(f"K0_{slope:g}", f"earth pressure at rest, M = {slope:g}", "-", earth_pressure_at_rest(slope), value,
                   EXPECTED)
        for slope, value in known.items()
    ]  # fmt: skip
    curve = [earth_pressure_at_rest(slope) for slope in CURVE_SLOPES.tolist()]
    panel = Panel(
        "M [-]", "earth pressure at rest [-]",
        (ours("material point", CURVE_SLOPES, curve), theirs("exact", list(known), list(known.values()))),
    )  # fmt: skip
    return Evaluation((*comparisons, _program_row(values)), (panel,))


CAM_CLAY = ValidationCase(
    "cam-clay",
    "Earth pressure and yield stress of the ellipse",
    "exact",
    ("column", "compaction"),
    "flow rule of the ellipse, for this validation; one plastic step of github.com/cb-geo/mpm, "
    "tests/materials/modified_cam_clay_test.cc",
    "formula; MIT",
    "Confined compression of mix with pt = 0 and a modulus of 1e13 Pa, by the material point that the finite elements "
    "integrate; M from 0.8 to 1.6.",
    _evaluate,
    seconds=0.5,
)
