"""One battery over all drives: energy, limit to rigid, strokes, period, peaks; end springs and the hydraulic drive."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from machine_cases import CART, HYDRAULIC, KLOSS, MASS, SIZE, dry, friction, published_law, stribeck
from machine_cases import HYDRAULIC as DRIVE
from published import CART_OF_C
from sampling import examples, sampled

from compact.drive import Crank, Rigid, simulate
from compact.machine.cart import EndSprings
from compact.machine.crankshaft import CRANK_ANGLES, simulate_crankshaft
from compact.machine.elastic_drive import ElasticDrive, simulate_elastic
from compact.machine.elastic_motion import integrate
from compact.machine.hydraulic_drive import Circuit, solve_valve_flow
from compact.machine.motor_drive import Motor, simulate_motor
from compact.machine.spring_forces import AT_NEAR_PLATE, NEAR_SPRING, CartState, SpringCart
from compact.motion.profile import LAWS, law
from compact.numerics.piecewise import PiecewisePolynomial

CARTS = {"bare": CART, "end springs": replace(CART, end_springs=EndSprings(4e3, 0.0, 0.08, stroke=0.4))}
DRIVES = {
    "rigid": Rigid(),
    "crank": Crank(0.2, 0.8),
    "elastic": ElasticDrive(1e6, 0.1 * math.sqrt(1e6 * MASS)),
    "backlash": ElasticDrive(1e6, 0.1 * math.sqrt(1e6 * MASS), 1e-3),
    "motor": Motor(KLOSS, 150.0, 1e-3, 20.0),
    "hydraulic": HYDRAULIC,
}
# drives that impose their law, and the tolerance of it
IMPOSING = {
    "elastic": (ElasticDrive(1e9, 1.4 * math.sqrt(1e9 * MASS)), "septic", 1e-3),
    "motor": (Motor(KLOSS, 150.0, 0.0, 1e9), "cubic", 1e-6),
    "hydraulic": (HYDRAULIC, "septic", 1e-12),
}


def law_of(drive, name, duration=3.0):
    return law("crank" if drive == "crank" else name, stroke=0.4, duration=duration, rod_length=0.8)


@pytest.mark.parametrize("cart", CARTS)
@pytest.mark.parametrize("name", ["cubic", "septic"])
@pytest.mark.parametrize("drive", DRIVES)
def test_work_of_the_drive_is_that_of_the_resistance_and_of_its_damper(drive, name, cart):
    run = simulate(CARTS[cart], DRIVES[drive], law_of(drive, name), dry)
    lost = 0.0
    if drive in ("elastic", "backlash"):
        lost = DRIVES[drive].damping * np.sum(run.weights * run.motion.elongation_rate**2)
    work = np.sum(run.weights * run.state.resistance * run.state.velocity)
    assert run.energy == pytest.approx(work + lost, rel=1e-6)
    if not lost:
        assert work == pytest.approx(0.8 * SIZE, rel=1e-6)
    assert getattr(run, "energy_residual", 0.0) < 1e-6


@pytest.mark.parametrize("cart", CARTS)
@pytest.mark.parametrize("drive", IMPOSING)
def test_drive_that_imposes_the_law_agrees_with_the_rigid_drive(drive, cart):
    made, name, tolerance = IMPOSING[drive]
    run = simulate(CARTS[cart], made, law_of(drive, name), lambda v, a: 1e3 * v)
    rigid = simulate(CARTS[cart], Rigid(), law_of(drive, name, run.period / 2), lambda v, a: 1e3 * v)
    assert (run.peak_force, run.peak_power) == pytest.approx((rigid.peak_force, rigid.peak_power), rel=tolerance)
    assert run.rms_power == pytest.approx(rigid.rms_power, rel=tolerance)


@pytest.mark.parametrize("name", ["cubic", "reversal-4"])
@pytest.mark.parametrize("drive", ["rigid", "elastic", "backlash", "hydraulic"])
def test_both_strokes_require_the_same_of_a_symmetric_machine(drive, name):
    """The return stroke mirrors the forward one: the force changes its sign half a cycle later."""
    run = simulate(CARTS["end springs"], DRIVES[drive], law_of(drive, name), dry)
    late = run.time > run.period / 2
    forward, back = run.drive_force[~late], run.drive_force[late]
    assert forward.max() == pytest.approx(-back.min(), rel=1e-3)
    assert forward.min() == pytest.approx(-back.max(), rel=1e-3, abs=1e-3 * SIZE)
    halves = [np.sum((run.weights * run.drive_power)[side]) for side in (late, ~late)]
    assert halves[0] == pytest.approx(halves[1], rel=1e-3)


@pytest.mark.sampled(24)
@pytest.mark.parametrize("name", ["quintic", "parabolic", "reversal-4", "constant-velocity"])
@pytest.mark.parametrize(
    ("stiffness", "backlash"), [(1e5, 0.0), (1e9, 0.0), (1e6, 1e-3), (1e6, 1e-4), (1e6, 2e-3)], ids=str
)
@pytest.mark.parametrize("regime", ["periodic", "rest"])
@pytest.mark.parametrize(
    ("springs", "resistance"), [(EndSprings(2e4, 300.0, 0.08, stroke=0.4), stribeck), (None, friction(1500.0))]
)
def test_energy_balance_of_any_spring(regime, stiffness, backlash, name, springs, resistance):
    drive = ElasticDrive(stiffness, 0.1 * math.sqrt(stiffness * MASS), backlash)
    cart = replace(CART_OF_C if springs else CART, end_springs=springs)
    run = simulate_elastic(cart, drive, law_of("elastic", name).cycle(0.5, 0.2), resistance, regime=regime)
    assert run.energy_residual < 1e-9
    assert run.shocks  # the acceleration jumps at each stop by friction
    assert {-1, 0, 1} & set(run.trajectory.zone.tolist())
    assert set(run.trajectory.flank.tolist()) - {1} == ({-1, 0} if backlash else set())


@pytest.mark.parametrize("cart", CARTS)
@pytest.mark.parametrize("drive", ["elastic", "backlash", "motor"])
def test_periodic_regime_ends_where_it_starts_and_does_not_hang_on_the_tolerance(drive, cart, monkeypatch):
    motion, tolerances, runs = law_of(drive, "cubic"), (1e-8, 1e-10), []
    if drive == "motor":
        for tolerance in tolerances:
            monkeypatch.setattr("compact.machine.shaft.ENERGY_TOLERANCE", tolerance)
            runs.append(simulate_motor(CARTS[cart], DRIVES[drive], motion, stribeck))
    else:
        drives = [replace(DRIVES[drive], tolerance=each) for each in tolerances]
        runs = [simulate_elastic(CARTS[cart], each, motion, stribeck) for each in drives]
    for run in runs:
        ends = (
            (run.speed[[0, -1]],)
            if drive == "motor"
            else zip(run.trajectory.start[:2], run.trajectory.end[:2], strict=True)
        )
        assert all(one == pytest.approx(other, rel=1e-8, abs=1e-12) for one, other in ends)
    names = ("peak_force", "peak_power", "rms_force", "drawn_energy")
    assert [getattr(runs[0], name) for name in names] == pytest.approx([getattr(runs[1], name) for name in names], 2e-7)


@pytest.mark.parametrize("drive", DRIVES)
def test_statistics_of_a_run_are_consistent(drive):
    run = simulate(CARTS["end springs"], DRIVES[drive], law_of(drive, "quintic"), dry)
    assert np.abs(run.drive_force).max() <= run.peak_force * (1 + 1e-9)
    assert run.peak_force == pytest.approx(np.abs(run.drive_force).max(), rel=1e-2)
    assert np.abs(run.drive_power).max() <= run.peak_power * (1 + 1e-9)
    assert run.mean_force <= run.rms_force <= run.peak_force
    assert run.energy <= run.drawn_energy * (1 + 1e-9)
    assert run.mean_power * run.period == pytest.approx(run.energy, rel=1e-12)
    assert run.weights.sum() == pytest.approx(run.period, rel=1e-12)


def test_drawn_energy_and_mean_force_of_an_oscillation_are_exact():
    """Steps end where the drive force changes its sign."""
    run = simulate(CARTS["bare"], ElasticDrive(1e6, 2e3), law_of("elastic", "parabolic", 0.889), dry)
    time = np.linspace(0, run.period, 200_001)
    motion = run.trajectory.at(time)
    power = motion.drive_force * motion.driven_velocity
    assert run.drawn_energy == pytest.approx(np.trapezoid(np.maximum(power, 0), time), rel=1e-6)
    assert run.mean_force == pytest.approx(np.trapezoid(np.abs(motion.drive_force), time) / run.period, rel=1e-6)


# ---- End springs: closed forms, work, all drives, errors


WITHOUT_IMPULSE = [name for name in LAWS if name not in ("constant-velocity", "gear-sector")]


def cart_with_springs(stiffness=4e3, preload=300.0, length=0.08, cart=CART):
    return replace(cart, end_springs=EndSprings(stiffness, preload, length, stroke=0.4))


# closed form


@pytest.mark.parametrize("duration", [3.0, 0.3])
def test_tuned_springs_balance_the_inertia_of_the_harmonic_law(duration):
    """k = m (pi/T)^2 over half the stroke at each end makes the law a free oscillation: H = F."""
    stiffness = CART.mass * (np.pi / duration) ** 2
    run = simulate(cart_with_springs(stiffness, 0.0, 0.2), Rigid(), published_law("harmonic", duration), dry)
    assert np.abs(run.drive_force) == pytest.approx(SIZE, rel=1e-9)
    assert run.peak_force == pytest.approx(SIZE, rel=1e-9)
    assert run.drawn_energy == pytest.approx(0.8 * SIZE, rel=1e-9)


@pytest.mark.parametrize("preload", [0.0, 300.0, 1500.0])
def test_springs_reduce_the_peak_of_the_parabolic_law(preload):
    """a = 4 s/T^2 up to the middle; within the spring the force is smaller by P + k (l - x)."""
    acceleration = 4 * 0.4 / 9
    run = simulate(cart_with_springs(0.0, preload, 0.2), Rigid(), published_law("parabolic"), dry)
    push = preload - CART.mass * acceleration
    assert run.peak_force == pytest.approx(SIZE + abs(push), rel=1e-9)


def test_energy_of_a_spring_is_the_integral_of_its_force():
    springs = EndSprings(4e3, 300.0, 0.08, stroke=0.4)
    x, weight = np.polynomial.legendre.leggauss(20)
    x, weight = 0.04 * (1 + x), 0.04 * weight
    assert springs.energy(0.0) == pytest.approx(weight @ springs.force(x, np.ones(20)), rel=1e-13)
    assert springs.energy([0.1, 0.2, 0.4]) == pytest.approx([0, 0, springs.energy(0.0)], abs=1e-12)
    assert [springs.force(0.03, 1.0), -springs.force(0.37, -1.0)] == pytest.approx([300 + 4e3 * 0.05] * 2)


# every drive


def test_springs_do_no_net_work_on_a_crankshaft():
    crank = Crank(0.2, 0.8)
    bare, run = (
        simulate_crankshaft(cart, crank, np.pi / 3, dry, CRANK_ANGLES[2]) for cart in (CART, cart_with_springs())
    )
    assert run.mean(run.power) == pytest.approx(bare.mean(bare.power), rel=1e-9)
    alone, even = (
        simulate_crankshaft(cart_with_springs(), crank, np.pi / 3, dry),
        simulate(cart_with_springs(), crank, published_law("crank"), dry),
    )
    assert alone.peak_power == pytest.approx(even.peak_power, rel=1e-6)


def test_energy_balance_of_four_carts_with_springs_on_a_motor():
    motor = Motor(KLOSS, 150.0, 1e-3, 20.0, CRANK_ANGLES[4])
    bare, run = (simulate(cart, motor, published_law("cubic"), dry) for cart in (CART, cart_with_springs()))
    assert run.energy_residual < 1e-8
    assert run.energy == pytest.approx(0.8 * SIZE, rel=1e-6)
    near = run.state.position < 0.08
    assert run.state.forces.drive_force[near].min() < bare.state.forces.drive_force[bare.state.position < 0.08].min()


# behind an elastic drive


@pytest.mark.parametrize("stiffness", [1e5, 1e9])
def test_tuned_springs_require_no_force_of_an_elastic_drive(stiffness):
    tuned = CART.mass * (np.pi / 3.0) ** 2
    drive = ElasticDrive(stiffness, 0.1 * np.sqrt(stiffness * CART.mass))
    run = simulate_elastic(cart_with_springs(tuned, 0.0, 0.2), drive, published_law("harmonic"), lambda v, a: 0.0 * v)
    assert run.peak_force < 1e-7 * CART.mass * 0.2 * (np.pi / 3) ** 2


def bounce(stiffness, preload, push, friction, speed, time):
    """Trajectory of a cart that moves into its near spring under a constant force, part of its resistance."""
    scales = {"force_scale": max(friction, preload, 100.0), "tolerance": 1e-7}
    cart = SpringCart(CART.mass, 1e-9, 0.0, 0.0, float(stiffness), preload, 0.08, 0.4, **scales)
    driven_end = PiecewisePolynomial(np.array([0.0, time]), np.array([[0.08] + [0.0] * 10]))
    table = PiecewisePolynomial(np.array([-1.0, 0.0, 1.0]), np.array([[push - friction], [push + friction]]))
    start = CartState(0.0, -speed, 1, int(NEAR_SPRING))
    trajectory, complete, _ = integrate(cart.with_tables(table), driven_end, start, 2000)
    assert complete
    return trajectory


@pytest.mark.parametrize("preload", [0.0, 50.0, 3000.0])
def test_contact_time_of_a_free_cart_with_its_spring(preload):
    """z'' = -(P + p z)/m: the cart returns after 2/w atan(v p/(w P)) with its initial speed."""
    stiffness, speed = 4e5, 0.2
    w = np.sqrt(stiffness / CART.mass)
    trajectory = bounce(stiffness, preload, 0.0, 0.0, speed, 0.2)
    assert np.all(np.diff(trajectory.zone) <= 0)
    away = trajectory.begin[np.flatnonzero(trajectory.zone == 0)[:1]]
    assert away == pytest.approx(2 / w * np.arctan2(speed * stiffness, w * preload), rel=1e-9)
    assert trajectory.at(away)[1] == pytest.approx([speed], rel=1e-9)


def test_driven_cart_comes_to_rest_at_the_plate_of_its_spring():
    """F < h < P - F: each bounce reduces the speed by the same ratio, until the plate holds the cart."""
    preload, push, size, speed, mass = 3000.0, 1200.0, 800.0, 0.05, CART.mass
    net = preload - push
    into, out, away, back = np.array([net + size, net - size, push + size, push - size]) / mass
    left, again = speed * np.sqrt(out / into), speed * np.sqrt(out / into * back / away)
    time = (speed / into + left / out + left / away + again / back) / (1 - again / speed)
    trajectory = bounce(0.0, preload, push, size, speed, 2 * time)
    assert trajectory.end[2:4] == (1, AT_NEAR_PLATE)
    assert trajectory.end.velocity == 0
    assert trajectory.begin[-1] == pytest.approx(time, rel=3e-5)
    assert trajectory.at(trajectory.begin[-1:]).position == pytest.approx([0.08], abs=1e-9)
    assert len(trajectory.rows) < 400


# properties


@examples(6, slow=25)
@given(st.sampled_from(WITHOUT_IMPULSE), st.floats(0, 1e5), st.floats(0, 5e3), st.floats(1e-3, 0.2))
def test_any_springs_do_no_net_work(name, stiffness, preload, length):
    run = simulate(cart_with_springs(stiffness, preload, length), Rigid(), published_law(name), dry)
    turned = preload * length + stiffness * length**2 / 2
    assert run.energy == pytest.approx(0.8 * SIZE, abs=1e-6 * (0.8 * SIZE + turned))


# ---- Hydraulic drive: closed forms, inverse and forward problem, balances, limits, errors


def constant(area, time=2.0):
    """Constant valve area [m2]."""
    return PiecewisePolynomial(np.array([0.0, time]), np.array([[area]]))


# closed form


@pytest.mark.parametrize(
    ("inlet", "outlet"), sampled([(1e-6, 2e-6), (1e-6, 4e-6), (3e-6, 2e-6), (3e-6, 4e-6)], [(3e-6, 2e-6)])
)
def test_constant_valve_areas_yield_a_constant_speed(inlet, outlet):
    """v^2 (k_in + k_out) = p_s - F/A, k = rho/2 (A/(Cd a))^2, far above the laminar drop."""
    resistances = [870 / 2 * (1e-3 / (0.62 * area)) ** 2 for area in (inlet, outlet)]
    speed = math.sqrt((8e6 - SIZE / 1e-3) / sum(resistances))
    stroke = Circuit(CART, DRIVE, 0.4, (constant(inlet, 0.2 / speed), constant(outlet, 0.2 / speed)), dry).simulate()
    assert stroke.velocity[-1] == pytest.approx(speed, rel=1e-5)
    assert stroke.outlet_pressure[-1] == pytest.approx(resistances[1] * speed**2, rel=1e-4)


@pytest.mark.slow
def test_added_mass_adds_to_the_mass_of_the_cart():
    """W = F + 400 kg v' adds 400 kg to the cart."""
    areas = constant(1e-6, 0.3), constant(2e-5, 0.3)
    lagging = Circuit(CART, DRIVE, 0.4, areas, lambda v, a: dry(v, a) + 400.0 * a).simulate()
    heavier = Circuit(replace(CART, mass=CART.mass + 400.0), DRIVE, 0.4, areas, dry).simulate()
    assert lagging.position[-1] == pytest.approx(heavier.position[-1], rel=1e-6)
    assert lagging.velocity[-1] == pytest.approx(heavier.velocity[-1], rel=1e-4)
    assert lagging.energy_residual < 1e-6


@pytest.mark.slow
def test_small_pump_flow_limits_the_mean_speed():
    """x = (Q t - V p/K)/A within the oscillation v/w of the cart on its oil, w^2 = A^2 K/(V m)."""
    drive = replace(DRIVE, pump_flow=5e-5)
    stroke = Circuit(CART, drive, 0.4, (constant(2e-5, 0.5), constant(2e-5, 0.5)), dry).simulate()
    frequency = 0.05 / math.sqrt(1e-6 * 1.4e9 / 1.3e-4 / CART.mass)
    assert stroke.position[-1] == pytest.approx(0.05 * 0.5 - 1e-4 * SIZE / 1e-6 / 1.4e9, abs=1.1 * frequency)
    assert stroke.energies["relief"] < 0.05 * stroke.energies["pump"]  # it opens at pressure peaks


def test_closed_cylinders_are_an_oil_spring():
    """A cart between closed cylinders oscillates with w^2 = 2 A^2 K/(V m)."""
    drive = replace(DRIVE, dead_volume=1.0, piston_area=0.1, supply_pressure=1e-3)
    areas = constant(1e-12, 0.03), constant(1e-12, 0.03)
    shut = Circuit(CART, drive, 0.4, areas, lambda v, a: 0 * v).simulate((2e3, 0.0))
    frequency = math.sqrt(2 * 0.1**2 * 1.4e9 / (1.02 * CART.mass))
    fastest = 2e3 * 0.1 / (CART.mass * frequency)  # the initial pressure of one cylinder distributes over both
    assert np.abs(shut.velocity).max() == pytest.approx(fastest, rel=0.01)


@pytest.mark.parametrize("drop", [1e-3, 1.0, 1e3, 1e7])
def test_drop_and_area_invert_the_flow(drop):
    flow = DRIVE.flow(3e-6, drop)
    assert DRIVE.drop(flow, 3e-6) == pytest.approx(drop, rel=1e-12)
    assert DRIVE.area(flow, drop) == pytest.approx(3e-6, rel=1e-14)
    if drop > 1e6:
        assert flow == pytest.approx(0.62 * 3e-6 * math.sqrt(2 * drop / 870), rel=1e-7)


@pytest.mark.parametrize("force", [3000.0, 0.0, -2500.0])
def test_valve_flow_balances_the_force(force):
    stroke = solve_valve_flow(DRIVE, np.array([0.2]), np.array([force]))
    assert 1e-3 * (stroke.inlet_pressure - stroke.outlet_pressure) == pytest.approx(force, abs=1e-9)
    assert DRIVE.flow(stroke.inlet_area, 8e6 - stroke.inlet_pressure) == pytest.approx(stroke.flow, rel=1e-12)
    assert DRIVE.flow(stroke.outlet_area, stroke.outlet_pressure) == pytest.approx(stroke.flow, rel=1e-12)
    assert stroke.inlet_pressure >= 0
    assert stroke.outlet_area <= DRIVE.valve_area


# inverse and forward problem


@pytest.mark.parametrize("name", sampled(["cubic", "quintic", "reversal-4"], ["cubic"]))
@pytest.mark.parametrize("cart", CARTS)
def test_forward_problem_reproduces_the_law(name, cart):
    run = simulate(CARTS[cart], DRIVE, published_law(name), dry)
    stroke = run.simulate_stroke()
    position = published_law(name).position(stroke.time)
    assert np.abs(stroke.position - position).max() < 1e-3 * 0.4
    assert stroke.energy_residual < 1e-6
    assert stroke.energies["resistance_work"] == pytest.approx(SIZE * stroke.position[-1], rel=1e-5)


@pytest.mark.slow
def test_error_is_proportional_to_the_compressibility_of_the_oil():
    moduli, errors = np.array([1e9, 4e9]), []
    for modulus in moduli:
        run = simulate(CART, replace(DRIVE, bulk_modulus=modulus), published_law("cubic"), dry)
        stroke = run.simulate_stroke()
        errors.append(np.abs(stroke.position - published_law("cubic").position(stroke.time)).max())
    order = np.polyfit(np.log(moduli), np.log(errors), 1)[0]
    assert order == pytest.approx(-1, abs=0.05), f"the error falls as K^{order:.2f}"


# balances


@pytest.mark.parametrize("name", ["parabolic", "harmonic", "reversal-3", "septic"])
def test_energy_balance_of_pump_cart_and_valves(name):
    run = simulate(CART, DRIVE, published_law(name), dry)
    assert run.energy == pytest.approx(0.8 * SIZE, rel=1e-9)
    assert run.energy_residual < 1e-12
    assert run.pump_work == pytest.approx(8e6 * 5e-4 * 6.0, rel=1e-12)
    assert run.throttle_heat > 0 < run.relief_heat


# hard cases


def test_cart_is_at_rest_until_breakaway():
    """p_in rises as K Q/V at full supply pressure: t = F V/(A K Q) to first order in p/p_s."""
    drive = replace(DRIVE, supply_pressure=8e8, pump_flow=1.0)
    stroke = Circuit(CART, drive, 0.4, (constant(1e-8, 0.4), constant(2e-5, 0.4)), dry).simulate()
    wait = SIZE / 1e-3 * 1e-4 / (1.4e9 * drive.flow(1e-8, 8e8))
    assert np.abs(stroke.velocity[stroke.time < 0.99 * wait]).max() < 1e-12
    standing = stroke.time[np.abs(stroke.velocity) < 1e-12]
    assert standing.max() == pytest.approx(wait, rel=0.01)


@pytest.mark.parametrize("name", sampled(["quintic", "septic", "cycloidal", "combined-4"], ["quintic"]))
def test_valve_areas_without_resistance(name):
    """Force and flow vanish at both ends: the outlet valve is open at the start and closed at the stop."""
    run = simulate(CART, DRIVE, published_law(name, 2.0), lambda v, a: 0 * v)
    inlet, outlet = run.valve_areas()
    assert inlet(np.array([0.0, 2.0])) == pytest.approx(0, abs=1e-12)
    assert outlet(np.array([0.0, 2.0])) == pytest.approx([2e-5, 0], abs=1e-11)
    stroke = run.simulate_stroke()
    assert np.abs(stroke.position - published_law(name, 2.0).position(stroke.time)).max() < 1e-3 * 0.4
    assert stroke.energy_residual < 1e-6


# errors


@pytest.mark.parametrize(
    ("changes", "name", "lack"),
    [
        ({"supply_pressure": 3e6}, "cubic", "supply pressure"),
        ({"pump_flow": 1e-4}, "cubic", "pump flow"),
        ({"valve_area": 3.5e-6}, "cubic", "valve area"),
        ({}, "constant-velocity", "force: the velocity jumps"),
    ],
)
def test_insufficient_drive_names_the_quantity(changes, name, lack):
    run = simulate(CART, replace(DRIVE, **changes), published_law(name), dry)
    assert run.lack == lack
    with pytest.raises(RuntimeError, match=f"the drive cannot follow '{name}': insufficient {lack}; use"):
        run.valve_areas()
