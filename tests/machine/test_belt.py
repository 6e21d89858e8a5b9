"""Belt between motor and gear: closed forms of the creep, Eytelwein's limit, balances, limits, errors."""

from dataclasses import replace

import numpy as np
import pytest
from machine_cases import CART, KLOSS, SIZE, dry, published_law
from scipy.integrate import solve_ivp

from compact.machine.motor_drive import Motor, simulate_motor
from compact.machine.shaft import Belt, LinearTorqueCurve

BELT = Belt(pulley_radius=0.1, stiffness=50e3, preload=500.0, friction=0.4, wrap=3.0)
STRONG = replace(BELT, preload=2500.0)


def simulate(belt, curve=KLOSS, name="quintic", cart=CART, resistance=dry, inertias=(0.01, 50.0)):
    return simulate_motor(cart, Motor(curve, 150.0, *inertias, belt=belt), published_law(name), resistance)


# closed form


def test_linear_motor_behind_a_belt_in_closed_form():
    """w (1 - T_s (1 - w/w_n)/C) = w_g is a quadratic of w."""
    curve, speed = LinearTorqueCurve(stall_torque=80.0, no_load_speed=157.0), np.linspace(0, 200, 81)
    C = BELT.creep_torque
    bent, straight = 80.0 / (C * 157.0), 1 - 80.0 / C
    exact = (-straight + np.sqrt(straight**2 + 4 * bent * speed)) / (2 * bent)
    assert BELT.motor_speed(curve.torque, speed) == pytest.approx(exact, rel=1e-12, abs=1e-12)
    motor = Motor(curve, 10.0, 0.0, 1.0, belt=BELT)
    assert motor.torque(speed / 10) == pytest.approx(10 * 80.0 * (1 - exact / 157.0), rel=1e-12, abs=1e-10)
    # near no load the curve is linear, with a slope reduced by the creep at stall
    slope = (motor.torque(15.7) - motor.torque(15.6)) / 1.0
    assert slope == pytest.approx(-10 * 80.0 / 157.0 / (1 + 80.0 / C), rel=1e-3)


def test_slip_torque_is_eytelweins_limit():
    """F1/F2 = e^(mu alpha) by integration along the wrap, and F1 + F2 = 2 F0."""
    along = solve_ivp(lambda angle, tension: BELT.friction * tension, (0, BELT.wrap), [1.0], rtol=1e-10, atol=1e-12)
    ratio = along.y[0, -1]
    slack = 2 * BELT.preload / (1 + ratio)
    assert BELT.slip_torque == pytest.approx(BELT.pulley_radius * (ratio - 1) * slack, rel=1e-8)
    assert BELT.required_preload(BELT.slip_torque) == pytest.approx(BELT.preload, rel=1e-14)


# independent solution


@pytest.mark.slow
def test_speed_agrees_with_a_general_solver():
    """w = g phi'/(1 - T_b/C) with T_b = T(w) - J_m g phi'', integrated over time."""
    run = simulate(STRONG, inertias=(0.01, 30.0))
    motor, cycle = run.drive, run.cycle
    rate, C = cycle.period / (2 * np.pi), STRONG.creep_torque

    def taken(angle, speed, acceleration):
        slope, curvature = (float(cycle.derivative(angle * rate, k)) * rate**k for k in (1, 2))
        return (CART.mass * (curvature * speed**2 + slope * acceleration) + SIZE * np.sign(slope)) * slope

    def rates(time, state):
        angle, speed = state
        acceleration, before = 0.0, None
        for _ in range(60):  # secant iteration on the acceleration
            pull = (30.0 * acceleration + taken(angle, speed, acceleration)) / 150.0
            torque = float(KLOSS.torque(150.0 * speed / (1 - pull / C)))
            left = 150.0 * torque - motor.inertia * acceleration - taken(angle, speed, acceleration)
            if abs(left) < 1e-10:
                break
            slope = -motor.inertia if before is None else (left - before[1]) / (acceleration - before[0])
            before, acceleration = (acceleration, left), acceleration - left / slope
        return [speed, acceleration]

    k = np.abs(run.angle - 0.5 * np.pi).argmin()
    got = solve_ivp(rates, (0, run.time[k]), [1e-12, run.speed[0]], "DOP853", rtol=1e-8, atol=1e-10)
    assert got.y[:, -1] == pytest.approx([run.angle[k], run.speed[k]], rel=1e-6)


# balances


def test_belt_loss_is_the_power_of_its_creep():
    run = simulate(STRONG)
    motor = run.drive
    assert run.energy_residual < 1e-8
    motor_work = np.sum(run.weights * run.motor_power)
    assert motor_work == pytest.approx(0.8 * SIZE + run.belt_loss, rel=1e-8)
    creep = run.belt_torque / STRONG.creep_torque
    own = motor.motor_speed(run.speed, run.revolution.acceleration.ravel())
    assert own * (1 - creep) == pytest.approx(150.0 * run.speed, rel=1e-12)
    # dissipation of the belt; the rotor stores no energy over a revolution, except by the rate of the creep
    assert run.belt_loss == pytest.approx(np.sum(run.weights * run.belt_torque * (own - 150.0 * run.speed)), rel=0.02)
    assert run.belt_loss > 0
    assert run.belt_creep == pytest.approx(np.abs(creep).max(), rel=2e-4)
    assert run.belt_creep >= np.abs(creep).max()  # between the nodes
    assert run.peak_motor_power > np.abs(run.motor_torque * run.speed).max()


# limits


def test_stiff_belt_has_no_effect():
    stiff, none = (simulate(belt) for belt in (replace(STRONG, stiffness=1e13), None))
    assert stiff.speed == pytest.approx(none.speed, rel=1e-8)
    assert stiff.peak_motor_power == pytest.approx(none.peak_motor_power, rel=1e-7)
    assert none.belt_loss == pytest.approx(0, abs=1e-9)
    assert none.belt_creep == 0


# errors


def test_error_of_a_slipping_belt_states_a_sufficient_preload():
    weak = replace(BELT, preload=40.0)
    with pytest.raises(RuntimeError, match=r"the belt slips under 'quintic': .* N m on the motor pulley") as caught:
        simulate(weak)
    preload = float(str(caught.value).split("at least ")[1].split()[0])
    run = simulate(replace(weak, preload=1.001 * preload))
    assert np.abs(run.belt_torque).max() == pytest.approx(run.drive.belt.slip_torque, rel=3e-3)
