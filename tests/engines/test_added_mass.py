"""Added mass of `fem` and `spectral` over the speed: recorded values of both and of a transient solution.

The transient solution by finite elements (`engines.fem.transient`, removed after revision 8d00c6b) accelerated the
roller uniformly from steady motion, over eight relaxation times, to the speed, with its default tolerances;
M = (F(a) - F(-a))/(2a) at |a| tau/v = 0.02. All values were computed on 23 November 2026 at that revision.
"""

import pytest

from compact.analysis.engines import expand_resistance as spectral_expansion
from compact.engines.fem.speed_derivative import expand_resistance
from compact.material.laws import Viscoelastic
from compact.rolling_contact import Layer, Ply, Roller

R = 0.11
MIX = Viscoelastic(youngs_modulus=10e6, poisson=0.3, branches=((1.0, 0.05),))
TWO = Viscoelastic(youngs_modulus=10e6, poisson=0.3, branches=((0.5, 0.02), (1.0, 0.1)))
PLIES = Ply(thickness=0.17, stiffness=1.0), Ply(thickness=0.05, stiffness=3.0)
DEEP = Roller(R, indentation=0.006)
CASES = {
    "slip": (Layer(0.22, base="slip"), DEEP, MIX),
    "bonded": (Layer(0.22), DEEP, MIX),
    "shallow": (Layer(0.22), Roller(R, indentation=0.002), MIX),
    "thin": (Layer(0.05), Roller(R, indentation=0.003), MIX),
    "plies": (Layer(0.22, plies=PLIES), DEEP, MIX),
    "two branches": (Layer(0.22, base="slip"), Roller(R, indentation=0.006, profile="circle"), TWO),
}
RECORDED = [  # case, speed [m/s], M by the transient solution, by "spectral" and by "fem" [kg/m]
    ("slip", 0.05, -391.857, -390.69502, -390.7034812),
    ("slip", 0.2, 26.2512, 26.24463905, 26.25050045),
    ("slip", 1.0, 11.0139, 10.98837025, 10.98737691),
    ("bonded", 0.05, -431.286, -428.9857134, -428.9937297),
    ("bonded", 0.2, 19.4239, 19.38579025, 19.39255946),
    ("bonded", 1.0, 13.4313, 13.33262848, 13.3312649),
    ("shallow", 0.05, -48.9333, -48.72729909, -48.72748706),
    ("shallow", 0.2, 10.9606, 10.95011258, 10.95103789),
    ("shallow", 1.0, 1.20868, 1.206796127, 1.206645772),
    ("thin", 0.05, -357.106, -355.7964975, -355.7927657),
    ("thin", 0.2, 33.9047, 33.80302669, 33.80038153),
    ("thin", 1.0, 11.3771, 11.29507815, 11.29528277),
    ("plies", 0.05, -534.25, -532.4075243, -532.4335015),
    ("plies", 0.2, 23.9484, 23.71291447, 23.73171685),
    ("plies", 1.0, 13.6299, 13.59717584, 13.59248869),
    ("two branches", 0.05, -571.244, -569.1787983, -569.1696845),
    ("two branches", 0.2, 93.4976, 94.81297521, 94.82736069),
    ("two branches", 1.0, 15.1702, 14.853749, 14.85223983),
]
TRANSIENT_ERROR = 0.015  # [-], of the larger of M and tau F', of its default tolerances
ROWS_OF_FAST_TESTS = (("slip", 0.2), ("thin", 1.0))


@pytest.mark.parametrize(("case", "speed", "transient", "recorded", "_fem"), RECORDED)
def test_spectral_added_mass_is_the_recorded_one_and_that_of_transients(case, speed, transient, recorded, _fem):
    found = spectral_expansion(*CASES[case], speed)
    scale = max(abs(found.added_mass), found.relaxation_time * abs(found.slope))
    assert found.added_mass == pytest.approx(recorded, abs=1e-7 * scale)
    assert found.added_mass == pytest.approx(transient, abs=TRANSIENT_ERROR * scale)


@pytest.mark.parametrize(
    ("case", "speed", "recorded"),
    [
        pytest.param(case, speed, fem, marks=[pytest.mark.slow] * ((case, speed) not in ROWS_OF_FAST_TESTS))
        for case, speed, _, _, fem in RECORDED
    ],
)
def test_fem_added_mass_is_the_recorded_one(case, speed, recorded):
    found = expand_resistance(*CASES[case], speed, estimate=False)
    scale = max(abs(found.added_mass), found.relaxation_time * abs(found.slope))
    assert found.added_mass == pytest.approx(recorded, abs=1e-6 * scale)
