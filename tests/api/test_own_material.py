"""Own materials by a state update: the column engine and the laboratory tests against laws with known results."""

import numpy as np
import pytest
from column_cases import DEPTH, FED_HEIGHT, MIX, R
from scipy.integrate import quad

import compact
from compact.analysis.material_tests import LaboratoryProgramme
from compact.engines.column.engine import roll
from compact.engines.column.state_update_columns import roll_state_update
from compact.material import cap_plasticity
from compact.rolling_contact import Layer, Roller

PLANE = np.ix_([0, 1, 3], [0, 1, 3])
E, NU = 20e6, 0.3
STIFFNESS = E / ((1 + NU) * (1 - 2 * NU)) * np.array([
    [1 - NU, NU, NU, 0], [NU, 1 - NU, NU, 0], [NU, NU, 1 - NU, 0], [0, 0, 0, 0.5 - NU],
])  # fmt: skip
CONFINED = STIFFNESS[1, 1]


def update_of_the_mix(state, strain):
    """Return the update by the law of `MIX` in plane strain."""
    after, tangent = cap_plasticity.integrate_points(MIX, state, strain[None, [0, 1, 3]])
    whole = np.zeros((4, 4))
    whole[PLANE] = tangent[0]
    return after.stress[0], after, whole


def elastic(stress, strain):
    stress = stress + STIFFNESS @ strain
    return stress, stress, STIFFNESS


@pytest.fixture(scope="module")
def own_mix():
    return compact.StateUpdate(update_of_the_mix, cap_plasticity.initial_state(MIX, 1), MIX.fed_density_ratio)


@pytest.fixture(scope="module")
def spring():
    return compact.StateUpdate(elastic, np.zeros(4), 0.94, name="spring")


@pytest.mark.parametrize(
    "target", [{"indentation": DEPTH}, {"load": 12e3}, pytest.param({"peak_pressure": 250e3}, marks=pytest.mark.slow)]
)
def test_law_of_the_mix_as_state_update_rolls_as_the_column_engine(own_mix, target):
    roller = Roller(R, profile="circle", **target)
    reference, found = (roll(Layer(FED_HEIGHT), roller, material, 0.2) for material in (MIX, own_mix))
    for name, error in zip(("load", "resistance"), found.error, strict=True):
        assert getattr(found, name) == pytest.approx(getattr(reference, name), rel=2 * error + 1e-6)
    assert max(found.error) <= 1e-4
    assert found.exit_height == pytest.approx(reference.exit_height, rel=1e-5)


def test_error_decreases_faster_than_the_increments(own_mix):
    roller = Roller(R, indentation=DEPTH, profile="circle")
    exact = roll(Layer(FED_HEIGHT), roller, MIX, 0.2)
    found = [roll_state_update(Layer(FED_HEIGHT), roller, own_mix, 0.2, rtol=rtol) for rtol in (1e-2, 1e-4)]
    errors = [abs(each.resistance - exact.resistance) for each in found]
    order = np.log(errors[0] / errors[1]) / np.log(found[1].own["increments"] / found[0].own["increments"])
    assert order > 1.3  # the second order, but for the ends of the contact and the first yield


def test_elastic_layer_has_its_closed_form_and_no_resistance(spring):
    depth = 2e-3
    contact = roll(Layer(0.2), Roller(R, indentation=depth), spring, -0.2, rtol=1e-5)
    lowest, edge = 0.2 - depth, np.sqrt(2 * R * depth)
    load = 2 * quad(lambda x: CONFINED * np.log(0.2 / (lowest + x**2 / (2 * R))), 0, edge, epsrel=1e-12)[0]
    assert contact.load == pytest.approx(load, rel=1e-5)
    assert abs(contact.resistance) < 1e-6 * load
    assert (contact.leading, -contact.trailing) == pytest.approx((edge, edge), rel=1e-6)
    assert contact.exit_height == pytest.approx(0.2)


def test_scene_rolls_over_an_own_material_to_its_density(own_mix):
    scene = compact.load_scene("compact/data/scenes/small.toml", **{"accuracy.engine": "column"})
    found = scene.roll(0.1, material=own_mix)[0]
    assert found.exit_density_ratio == pytest.approx(scene.mix.density_ratio, rel=1e-5)
    assert found.exit_height == pytest.approx(scene.product.height, rel=1e-5)
    pressed = scene.replaced(**{"contact.load": 9e3}).roll(0.1, material=own_mix)[0]
    assert pressed.load == pytest.approx(9e3 / scene.machine.roller_length, rel=1e-4)
    with pytest.raises(ValueError, match=r'an own material has no pore air; set mix.pore_air = "drained"'):
        scene.replaced(**{"mix.pore_air": "one-way"}).roll(0.1, material=own_mix)
    with pytest.raises(ValueError, match=r"an own material needs the engine column and one pass, got fem and 1"):
        scene.roll(0.1, engine="fem", material=own_mix)


def test_laboratory_tests_of_the_mix_equal_those_of_its_law(own_mix):
    found = {each.name: each for each in compact.laboratory_tests(own_mix, 150e3)}
    exact = LaboratoryProgramme(MIX, None, 150e3).test("oedometer")
    peak, top = found["oedometer"].axial_stress.argmax(), exact.axial_stress.argmax()
    assert found["oedometer"].lateral_stress[peak] == pytest.approx(exact.lateral_stress[top], rel=1e-5)
    assert found["oedometer"].axial_strain[peak] == pytest.approx(exact.axial_strain[top], rel=1e-4)
    assert found["oedometer"].axial_stress[-1] == pytest.approx(0, abs=1e-3)
    unconfined = LaboratoryProgramme(MIX, 0.98, 150e3).test("unconfined")
    assert found["unconfined"].strength == pytest.approx(unconfined.strength, rel=1e-8)


def test_laboratory_tests_of_an_elastic_material_have_closed_forms(spring):
    pressure = 1e5
    tests = compact.laboratory_tests(spring, pressure)
    oedometer, isotropic, unconfined, *_, shear = tests
    assert len(tests) == 6
    assert oedometer.axial_strain.max() == pytest.approx(pressure / CONFINED, rel=1e-12)
    assert oedometer.axial_strain[-1] == pytest.approx(0, abs=1e-15)
    assert isotropic.volume_strain[-1] == pytest.approx(pressure * 3 * (1 - 2 * NU) / E, rel=1e-12)
    assert unconfined.strength == pytest.approx(E / (1 - NU**2) * unconfined.axial_strain[-1], rel=1e-7)
    assert shear.deviator_stress[-1] == pytest.approx(2 * E / (1 + NU) * shear.axial_strain[-1], rel=1e-12)
    assert np.ptp(shear.density_ratio) < 1e-15
    assert repr(tests) == "<6 laboratory tests of spring>"
    assert len(tests.to_dataframe()) == sum(len(each.axial_strain) for each in tests)
    assert [len(panel.lines) for panel in tests.plot().axes] == [2, 2, 4, 5]
    assert "axial stress<" in tests._repr_html_()
