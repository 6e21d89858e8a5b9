"""Case of measured sand oedometers: laws fitted to the first half of a test and held to the second half.

Loading is a power law with an offset, e = e_0 + B (s/s_a)^a, by three constants. Rebound is the logarithmic
swelling e_r = C ln(s_max/s) by one constant. The mix of `column` has Heckel's law and one modulus of unloading; it is
fitted to the same halves, to state how far it is from sand.

The first half of loading ends at half of the largest stress, and that of unloading at half of the readings.
"""

import numpy as np
from scipy.optimize import least_squares

from compact.numerics import Array
from compact.validation.case import Computed, Panel, Rows, numbers, ours, read_rows, theirs

REFERENCE_STRESS = 100.0  # [kPa], s_a
TESTS = {"OE1": "loose", "OE12": "dense"}
LEAST_STRESS = 1.0  # [kPa], below which the weight of the cap and the reading of the stress count
FIT_TOLERANCE = 1e-12  # [-], of the least squares


def _readings(test: str, phase: str) -> tuple[Array, Array, float]:
    """Return axial stress [kPa], strain [%] and the first density ratio [-] of a phase of a test."""
    rows = read_rows("sand_oedometers.csv", test=test, phase=phase)
    density_ratio = 1 / (1 + float(rows[0]["void_ratio"]))
    return numbers(rows, "axial_stress_kPa"), numbers(rows, "axial_strain_percent"), density_ratio


def power_strain(constants: Array, stress: Array) -> Array:
    """Return the strain [%] of the power law at stresses [kPa]."""
    return constants[0] + constants[1] * (stress / REFERENCE_STRESS) ** constants[2]


def _proportional(x: Array, y: Array) -> float:
    """Return the factor of the least squares of y = factor x."""
    return float(x @ y / (x @ x))


def _test(name: str) -> tuple[dict[str, float], Panel]:
    """Fit the laws to the first halves of a test, and return the rows of the second halves with the diagram."""
    stress, strain, k0 = _readings(name, "loading")
    released, left, _ = _readings(name, "unloading")
    top, rebound = stress[-1], left[0] - left
    first, second, half = (stress > 0) & (stress <= top / 2), stress > top / 2, len(released) // 2

    fit = least_squares(
        lambda constants: power_strain(constants, stress[first]) - strain[first],
        (0.0, 1.0, 0.5), xtol=FIT_TOLERANCE, ftol=FIT_TOLERANCE, gtol=FIT_TOLERANCE,
    ).x  # fmt: skip
    swelling = _proportional(np.log(top / released[:half]), rebound[:half])
    logarithm = np.log((1 - k0) / (1 - k0 / (1 - strain[first] / 100)))
    slope = _proportional(stress[first], logarithm)  # of Heckel's line

    def heckel_strain(stress: Array) -> Array:
        return 100 * (1 - k0 / (1 - (1 - k0) * np.exp(-slope * stress)))

    held = released >= LEAST_STRESS
    unloading = left[0] - swelling * np.log(top / released[held])
    values = {
        "loading": np.abs(power_strain(fit, stress[second]) / strain[second] - 1).max(),
        "largest": power_strain(fit, top),
        "rebound_10": swelling * np.log(top / 10.0),
        "rebound_1": swelling * np.log(top / 1.0),
        "unloading": np.abs(unloading / left[held] - 1).max(),
        "heckel": heckel_strain(top),
        "modulus": _proportional(top - released[:half], rebound[:half]) * top,
    }
    x = np.geomspace(0.5, top, 80)
    curves = (
        ours("power law", x, power_strain(fit, x)),
        ours("swelling", x, left[0] - swelling * np.log(top / x)),
        ours("Heckel's law", x, heckel_strain(x)),
        theirs("loading, fitted half", stress[first], strain[first]),
        theirs("unloading", released[:-1], left[:-1]),
        theirs("loading, second half", stress[second], strain[second]),
    )
    panel = Panel("axial stress [kPa]", f"axial strain [%], {name} ({TESTS[name]})", curves, log_x=True)
    return {f"{name}_{key}": float(value) for key, value in values.items()}, panel


def sand_tests(_rows: Rows) -> Computed:
    """Compute both tests."""
    (loose, left), (dense, right) = map(_test, TESTS)
    return loose | dense, (left, right)
