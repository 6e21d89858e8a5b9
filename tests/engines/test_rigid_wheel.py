"""Rigid wheel on terrain: closed forms of simple laws, tables and functions, rebound, shear, refusals."""

import numpy as np
import pytest

from compact.engines.column.rigid_wheel import roll_wheel, textbook_wheel
from compact.material.pressure_sinkage import (
    DensityLaw,
    FunctionLaw,
    JohansonLaw,
    PeakAngle,
    PowerSinkage,
    ShearStrength,
    TabulatedLaw,
    Terrain,
    bekker,
    reece,
)
from compact.rolling_contact import Layer, Ply, Roller

RADIUS, DEPTH = 0.25, 0.03  # [m]
DEEP = Layer(1.0)
SHEAR = ShearStrength(1040.0, 28.0, 0.02)
SOIL = bekker(990.0, 1.52843e6, 1.1, width=0.15)


def wheel(law, layer=DEEP, target=None, rebound=np.inf, shear=None, peak=None, speed=1.0, **motion):
    roller = Roller(RADIUS, **(target or {"indentation": DEPTH}))
    return roll_wheel(layer, roller, Terrain(law, shear, peak, rebound), speed, **motion)


def test_a_linear_law_has_its_closed_form():
    """P = k [R^2 (t - sin t cos t)/2 - ...] of a circular segment: the submerged area over one side; F = k z^2/2."""
    found, k = wheel(PowerSinkage(1e6, 1.0)), 1e6
    t = found.entry_angle
    assert found.load == pytest.approx(k * RADIUS**2 * (t - np.sin(t) * np.cos(t)) / 2, rel=1e-12)
    assert found.resistance == pytest.approx(k * DEPTH**2 / 2, rel=1e-12)
    assert found.leading == pytest.approx(np.sqrt(2 * RADIUS * DEPTH - DEPTH**2), rel=1e-13)
    assert found.peak_pressure == pytest.approx(k * DEPTH, rel=1e-13)
    assert found.exit_height == pytest.approx(1.0 - DEPTH)


@pytest.mark.parametrize("exponent", [0.11, 0.5, 1.1, 1.6])
def test_the_resistance_is_the_work_of_compaction(exponent):
    found = wheel(PowerSinkage(1e6, exponent))
    assert found.resistance == pytest.approx(1e6 * DEPTH ** (exponent + 1) / (exponent + 1), rel=1e-12)
    assert found.compaction_resistance == pytest.approx(found.resistance, rel=1e-13)
    assert max(found.error) < 1e-11


def test_load_and_peak_pressure_are_inverted():
    for target in ({"load": 4000.0}, {"peak_pressure": 30e3}):
        found = wheel(SOIL, target=target)
        again = wheel(SOIL, target={"indentation": found.indentation})
        (name, value), *_ = target.items()
        assert getattr(again, name) == pytest.approx(value, rel=1e-12)


def test_bekker_and_reece_are_power_laws():
    assert bekker(990.0, 1.5e6, 1.1, 0.15) == PowerSinkage(990.0 / 0.15 + 1.5e6, 1.1)
    assert float(reece(1e3, 2e4, 0.8, 0.2).pressure(0.2)) == pytest.approx(1e3 + 2e4 * 0.2)


def test_a_table_and_a_function_of_a_law_have_its_forces():
    z = np.linspace(0, 0.05, 201)
    exact = wheel(SOIL)
    function = wheel(FunctionLaw(SOIL.pressure))
    table = wheel(TabulatedLaw(tuple(z), tuple(SOIL.pressure(z))))
    assert function.load == pytest.approx(exact.load, rel=1e-13)
    assert table.load == pytest.approx(exact.load, rel=1e-5)
    assert table.resistance == pytest.approx(exact.resistance, rel=1e-4)
    assert max(table.error) < 1e-9


def test_a_table_ends_where_its_data_end():
    z = (0.0, 0.01, 0.02)
    law = TabulatedLaw(z, tuple(SOIL.pressure(np.array(z))))
    with pytest.raises(ValueError, match="extend the table"):
        wheel(law, target={"load": 1e5})


def test_density_laws_refer_to_the_layer():
    layer, law = Layer(0.1), JohansonLaw(2e3, 8.0)
    found = wheel(law, layer)
    other = wheel(DensityLaw(0.6, lambda k: 2e3 * (k / 0.6) ** 8), layer)
    table = wheel(DensityLaw(0.6, tuple((k, 2e3 * (k / 0.6) ** 8) for k in np.linspace(0.6, 0.99, 100))), layer)
    assert found.peak_pressure == pytest.approx(2e3 * (0.1 / 0.07) ** 8, rel=1e-13)
    assert other.load == pytest.approx(found.load, rel=1e-12)
    assert table.load == pytest.approx(found.load, rel=1e-4)


def test_rebound_returns_its_elastic_work():
    """Behind the lowest point p = p0 - k_u (z0 - z) does the work p0^2/(2 k_u)."""
    modulus, rigid = 5e6, wheel(SOIL)
    found = wheel(SOIL, rebound=modulus)
    returned = found.peak_pressure**2 / (2 * modulus)
    assert found.resistance == pytest.approx(rigid.resistance - returned, rel=1e-12)
    assert found.compaction_resistance == pytest.approx(rigid.resistance, rel=1e-12)
    assert RADIUS * (1 - np.cos(found.exit_angle)) == pytest.approx(found.peak_pressure / modulus)
    assert found.exit_angle < 0 < found.entry_angle
    with pytest.raises(ValueError, match="rise above its surface"):
        wheel(SOIL, rebound=1e5)


def test_a_free_wheel_has_no_torque_and_skids():
    found = wheel(SOIL, shear=SHEAR, target={"load": 500 / 0.15})
    assert abs(found.torque) < 1e-9 * found.load * RADIUS
    assert -0.5 < found.slip < 0
    assert found.drawbar < 0
    braked = wheel(SOIL, shear=SHEAR, target={"load": 500 / 0.15}, torque=-50.0)
    assert braked.torque == pytest.approx(-50.0, rel=1e-9)
    assert braked.slip < found.slip


def test_the_drawbar_of_a_slipping_wheel_is_bounded_by_its_strength():
    """At full slip all shear strength is mobilised: T <= R int (c + sigma tan phi) ds."""
    found = wheel(SOIL, shear=ShearStrength(1040.0, 28.0, 1e-9), slip=0.9)
    rigid = wheel(SOIL)
    angle = found.entry_angle
    normal = RADIUS * np.trapezoid(found.pressure, np.arcsin(found.x / RADIUS))
    strength = 1040.0 * RADIUS * angle + normal * np.tan(np.radians(28.0))
    assert found.torque == pytest.approx(RADIUS * strength, rel=1e-3)
    assert found.drawbar + rigid.resistance > 0


def test_the_work_of_the_torque_covers_drawbar_and_shear():
    """T w - D v = R int tau (w - v cos t/R) ds + v int sigma sin t ds, with v = R w (1 - s)."""
    slip = 0.3
    found = wheel(SOIL, shear=SHEAR, slip=slip)
    rim, travel = 1.0, 1.0 - slip
    t = np.arcsin(found.x / RADIUS)
    shear = RADIUS * np.trapezoid(-found.shear_traction * (rim - travel * np.cos(t)), t)
    pressed = RADIUS * np.trapezoid(found.pressure * np.sin(t), t) * travel
    assert found.torque * rim / RADIUS - found.drawbar * travel == pytest.approx(shear + pressed, rel=1e-3)


def test_columns_under_skid_have_shear_of_both_signs():
    found = wheel(SOIL, shear=SHEAR, slip=-0.09)
    assert (found.shear_traction > 0).any()
    assert (found.shear_traction < 0).any()
    assert max(found.error) < 1e-9


def test_the_direction_of_travel_mirrors_the_contact():
    right, left = (wheel(SOIL, shear=SHEAR, slip=0.2, speed=speed) for speed in (1.0, -1.0))
    assert left.resistance == -right.resistance
    assert left.drawbar == right.drawbar
    assert left.x == pytest.approx(-right.x[::-1])
    assert left.pressure == pytest.approx(right.pressure[::-1])


def test_textbook_forms_are_near_the_circle():
    load = 500 / 0.15
    found = wheel(SOIL, target={"load": load})
    sinkage, resistance = textbook_wheel(SOIL, RADIUS, load)
    assert sinkage == pytest.approx(found.indentation, rel=0.01)
    assert resistance == pytest.approx(found.resistance, rel=0.01)


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ({"slip": 0.1}, "without `shear`"),
        ({"shear": SHEAR, "slip": 0.1, "torque": 1.0}, "not both"),
        ({"shear": SHEAR, "slip": 1.0}, "between -1 and 1"),
        ({"shear": SHEAR, "torque": 1e6}, "`torque` must lie between"),
        ({"shear": SHEAR, "peak": PeakAngle(0.4, 0.3), "slip": -0.6}, "within the contact"),
        ({"layer": Layer(0.02)}, "below the layer height"),
        ({"layer": Layer(0.1, plies=(Ply(0.1, 1.0),))}, "`plies`"),
        ({"target": {"indentation": 0.3}}, "below the radius"),
        ({"speed": 0.0}, "`speed` must not be 0"),
    ],
)
def test_foreign_input_is_refused(arguments, match):
    with pytest.raises(ValueError, match=match):
        wheel(SOIL, **arguments)


@pytest.mark.parametrize(
    ("build", "match"),
    [
        (lambda: PowerSinkage(0.0, 1.0), "`modulus` must be positive"),
        (lambda: TabulatedLaw((0.01, 0.02), (0.0, 1.0)), "must begin at 0"),
        (lambda: TabulatedLaw((0.0, 0.02), (1.0, 0.0)), "must not descend"),
        (lambda: TabulatedLaw((0.0, 0.0), (0.0, 1.0)), "must ascend"),
        (lambda: TabulatedLaw((0.0,), (0.0,)), "at least 2"),
        (lambda: DensityLaw(1.2, ((0.5, 1.0), (0.6, 2.0))), "below 1"),
        (lambda: ShearStrength(0.0, 90.0, 0.01), "below 90"),
        (lambda: Terrain(SOIL, peak=PeakAngle(0.4, 0.3)), "needs a `shear`"),
        (lambda: Terrain(SOIL, SHEAR, PeakAngle(0.4, 0.3), 1e6), "must be infinite"),
        (lambda: Terrain(SOIL, rebound_modulus=0.0), "must be positive"),
    ],
)
def test_laws_refuse_foreign_constants(build, match):
    with pytest.raises(ValueError, match=match):
        build()
