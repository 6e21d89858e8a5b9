"""Case of measured sand oedometers: laws fitted to the first half of a test and held to the second half.

Loading is a power law with an offset, e = e_0 + B (s/s_a)^a, by three constants. Rebound is the logarithmic
swelling e_r = C ln(s_max/s) by one constant. The mix of `column` has Heckel's law and one modulus of unloading; it is
fitted to the same halves, to state how far it is from sand.

The first half of loading ends at half of the largest stress, and that of unloading at half of the readings.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from compact.numerics import Array
from compact.validation.case import Comparison, Evaluation, Panel, ValidationCase, numbers, ours, read_rows, theirs

REFERENCE_STRESS = 100.0  # [kPa], s_a
TESTS = {"OE1": "loose", "OE12": "dense"}
EXPECTED = 0.05  # [-], of strains over the measured strain
LEAST_STRESS = 1.0  # [kPa], below which the weight of the cap and the reading of the stress count
REBOUND_STRESSES = (10.0, 1.0)  # [kPa]
READING = 0.005  # [%], resolution of the strain
FIT_TOLERANCE = 1e-12  # [-], of the least squares
FITTED = "fitted: the first half of the test"
HECKEL_REASON = "sand of hard grains has no Heckel curve at 400 kPa; use a table or a power law"
MODULUS_REASON = "one modulus of unloading; the stiffness of sand grows with the stress"


@dataclass(frozen=True, eq=False)
class Oedometer:
    """Readings of one test: axial stress [kPa] and strain [%] of loading and unloading, arrays of shape (n,)."""

    name: str
    stress: Array
    strain: Array
    released_stress: Array
    released_strain: Array
    density_ratio: float

    @property
    def first(self) -> Array:
        """True for readings of loading up to half of the largest stress, without the one at zero."""
        return (self.stress > 0) & (self.stress <= self.stress[-1] / 2)

    @property
    def second(self) -> Array:
        """True for readings of loading beyond half of the largest stress."""
        return self.stress > self.stress[-1] / 2

    @property
    def rebound(self) -> Array:
        """Rebound since the largest stress [%]."""
        return self.released_strain[0] - self.released_strain

    @property
    def first_release(self) -> slice:
        """First half of the readings of unloading."""
        return slice(0, len(self.released_stress) // 2)


def read_oedometer(name: str) -> Oedometer:
    """Read a test by its name.

    Returns
    -------
    Oedometer
    """
    loading, unloading = (
        read_rows("sand_oedometers.csv", test=name, phase=phase) for phase in ("loading", "unloading")
    )
    columns = "axial_stress_kPa", "axial_strain_percent"
    stress, strain, released_stress, released_strain = (
        numbers(rows, column) for rows in (loading, unloading) for column in columns
    )
    ratio = 1 / (1 + float(loading[0]["void_ratio"]))
    return Oedometer(name, stress, strain, released_stress, released_strain, ratio)


def power_law(test: Oedometer) -> Array:
    """Fit offset [%], factor [%] and exponent [-] of the power law to the first half of loading.

    Returns
    -------
    ndarray, shape (3,)
        Offset [%], factor [%] and exponent [-].
    """
    used = test.first

    def residual(constants: Array) -> Array:
        return power_strain(constants, test.stress[used]) - test.strain[used]

    found = least_squares(residual, (0.0, 1.0, 0.5), xtol=FIT_TOLERANCE, ftol=FIT_TOLERANCE, gtol=FIT_TOLERANCE)
    return found.x


def power_strain(constants: Array, stress: Array) -> Array:
    """Return the strain [%] of the power law at stresses [kPa]."""
    return constants[0] + constants[1] * (stress / REFERENCE_STRESS) ** constants[2]


def swelling_constant(test: Oedometer) -> float:
    """Fit C [%] of the swelling to the first half of unloading.

    Returns
    -------
    float
        C [%].
    """
    part = test.first_release
    logarithm = np.log(test.stress[-1] / test.released_stress[part])
    return float(logarithm @ test.rebound[part] / (logarithm @ logarithm))


def heckel_strain(test: Oedometer, stress: Array) -> Array:
    """Return the strain [%] at stresses [kPa] of Heckel's law from the initial density, fitted to the first half."""
    used, k0 = test.first, test.density_ratio
    logarithm = np.log((1 - k0) / (1 - k0 / (1 - test.strain[used] / 100)))
    slope = float(test.stress[used] @ logarithm / (test.stress[used] @ test.stress[used]))
    return 100 * (1 - k0 / (1 - (1 - k0) * np.exp(-slope * stress)))


def linear_rebound(test: Oedometer) -> float:
    """Return the rebound [%] to zero stress by one modulus, fitted to the first half of unloading."""
    part = test.first_release
    release = test.stress[-1] - test.released_stress[part]
    return float(release @ test.rebound[part] / (release @ release)) * test.stress[-1]


def _rows(test: Oedometer) -> list[Comparison]:
    name = f"{test.name} ({TESTS[test.name]})"
    constants, swelling = power_law(test), swelling_constant(test)
    second, top = test.second, test.stress[-1:]
    deviation = power_strain(constants, test.stress[second]) / test.strain[second] - 1
    found = [
        Comparison(
            f"{test.name}_loading", f"strain, second half of loading, largest deviation, {name}", "-",
            float(np.abs(deviation).max()), 0.0, EXPECTED, absolute=True, basis=FITTED,
            note=f"{constants[0]:.3f} % + {constants[1]:.3f} % (s/100 kPa)^{constants[2]:.3f}",
        ),
        Comparison(
            f"{test.name}_largest", f"strain at {top[0]:.0f} kPa, {name}", "%", float(power_strain(constants, top)[0]),
            float(test.strain[-1]), EXPECTED, READING, basis=FITTED,
        ),
    ]  # fmt: skip
    for stress in REBOUND_STRESSES:
        rebound = float(np.interp(-stress, -test.released_stress, test.rebound))
        found.append(Comparison(
            f"{test.name}_rebound_{stress:g}", f"rebound from {top[0]:.0f} to {stress:g} kPa, {name}", "%",
            swelling * float(np.log(top[0] / stress)), rebound, EXPECTED, READING, basis=FITTED,
            note=f"{swelling:.4f} % ln(s_max/s)",
        ))  # fmt: skip
    held = test.released_stress >= LEAST_STRESS
    strain = test.released_strain[0] - swelling * np.log(top[0] / test.released_stress[held])
    deviation = strain / test.released_strain[held] - 1
    return [
        *found,
        Comparison(
            f"{test.name}_unloading", f"strain on unloading to {LEAST_STRESS:g} kPa, largest deviation, {name}", "-",
            float(np.abs(deviation).max()), 0.0, EXPECTED, absolute=True, basis=FITTED,
        ),
        Comparison(
            f"{test.name}_heckel", f"strain at {top[0]:.0f} kPa by Heckel's law, {name}", "%",
            float(heckel_strain(test, top)[0]), float(test.strain[-1]), EXPECTED, READING, basis=FITTED,
            note=HECKEL_REASON,
        ),
        Comparison(
            f"{test.name}_modulus", f"rebound to zero stress by one modulus, {name}", "%", linear_rebound(test),
            float(test.rebound[-1]), EXPECTED, READING, basis=FITTED, note=MODULUS_REASON,
        ),
    ]  # fmt: skip


def _panel(test: Oedometer) -> Panel:
    """Draw strain over stress of one test."""
    constants, swelling, top = power_law(test), swelling_constant(test), test.stress[-1]
    stress = np.geomspace(0.5, top, 80)
    released = test.released_strain[0] - swelling * np.log(top / stress)
    half = test.stress[test.first]
    return Panel(
        "axial stress [kPa]", f"axial strain [%], {test.name} ({TESTS[test.name]})",
        (
            ours("power law", stress, power_strain(constants, stress)),
            ours("swelling", stress, released),
            ours("Heckel's law", stress, heckel_strain(test, stress)),
            theirs("loading, fitted half", half, test.strain[test.first]),
            theirs("unloading", test.released_stress[:-1], test.released_strain[:-1]),
            theirs("loading, second half", test.stress[test.second], test.strain[test.second]),
        ),
        log_x=True,
    )  # fmt: skip


def _evaluate() -> Evaluation:
    tests = [read_oedometer(name) for name in TESTS]
    return Evaluation(tuple(row for test in tests for row in _rows(test)), tuple(_panel(test) for test in tests))


SAND = ValidationCase(
    "karlsruhe-sand",
    "Sand in an oedometer, loading and rebound",
    "measurement",
    ("column",),
    "oedometer tests OE1 and OE12 on Karlsruhe fine sand, in github.com/gagankaushikmanyam/mechanics-sand-model, "
    "commit 1372ef2, credited there to the data base KFSDB of TU Braunschweig",
    "no licence file; facts only",
    "Loose (void ratio 1.04) and dense (0.72) sand, loaded to 407 kPa and released. A law is fitted to the first half "
    "of a branch and held to the second: loading to half of the largest stress, unloading to half of the readings (36 "
    "kPa). The radial stress was not measured.",
    _evaluate,
    seconds=0.1,
)
