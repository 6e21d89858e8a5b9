"""A roller through time: steady motion, published reversals, an independent program, joins, rest, refusals."""

import itertools
from dataclasses import dataclass, replace
from xml.etree import ElementTree

import numpy as np
import pytest

from compact import fem
from compact.engines.fem import contact_problem, discretisation, surface_compliance, transient
from compact.engines.fem.convected_memory import creep_function
from compact.engines.fem.transient import simulate_transient
from compact.material.laws import Elastic, Viscoelastic
from compact.mesh import RowMesh, mesh_for_error
from compact.motion.profile import law
from compact.rolling_contact import Layer, Ply, Roller, TransientResult

R = 0.11
LAYER = Layer(0.22)
MIX = Viscoelastic(10e6, 0.3, branches=((1.0, 0.1),))
THREE = Viscoelastic(10e6, 0.3, branches=((0.5, 0.02), (1.0, 0.1), (0.3, 1.0)))


@dataclass
class Accelerated:
    """s = v t + a t^2/2 over a duration."""

    speed: float
    acceleration_kept: float
    duration: float

    def position(self, time):
        return self.speed * np.asarray(time) + self.acceleration_kept * np.asarray(time) ** 2 / 2

    def velocity(self, time):
        return self.speed + self.acceleration_kept * np.asarray(time)


def pressed(indentation=0.003, **other):
    return Roller(R, indentation=indentation, **other)


WINKLER = Layer(0.1, "slip")  # so thin under its roller, b = 1 and R = 100, that it is a Winkler foundation


def on_winkler(motion, instants=(), **accuracy):
    """The `TransientResult` at m = kr = R = b = tau = 1 of contact.md e; F and N in its units, at the instants."""
    mix = Viscoelastic(0.91, 0.3, branches=((1.0, 1.0),))
    done = simulate_transient(WINKLER, Roller(100.0, indentation=0.005), mix, motion, instants=instants, **accuracy)
    at = [int(np.argmin(np.abs(done.time - instant))) for instant in instants]
    assert done.time[at] == pytest.approx(np.array(instants), abs=1e-12)
    return done, done.resistance[at] * 1e3, done.load[at] * 10


# closed form


def test_elastic_layer_resists_no_motion():
    done = simulate_transient(
        LAYER, pressed(), Elastic(10e6, 0.3), law("harmonic", 0.1, 1.0).cycle(far_dwell=0.2), estimate=False
    )
    steady = fem.roll(LAYER, pressed(), Elastic(10e6, 0.3), 1.0, estimate=False)
    assert done.load == pytest.approx(steady.load, rel=1e-6)
    assert np.abs(done.resistance).max() < 1e-6 * steady.load


def test_roller_that_stands_meets_the_relaxed_layer():
    done = simulate_transient(LAYER, pressed(), MIX, Accelerated(0.0, 0.0, 1.0), estimate=False)
    relaxed = fem.roll(LAYER, pressed(), Elastic(10e6, 0.3), 1.0, estimate=False)
    assert done.load == pytest.approx(relaxed.load, rel=1e-4)
    assert np.abs(done.resistance).max() < 1e-5 * relaxed.load


@pytest.mark.parametrize(("rolling", "torque"), [("sliding", None), ("free", None), ("driven", 30.0)])
@pytest.mark.parametrize("mix", [Elastic(10e6, 0.3), MIX], ids=["elastic", "viscoelastic"])
def test_roller_with_friction_goes_on_in_steady_motion(rolling, torque, mix):
    roller = pressed(friction=0.3, rolling=rolling)
    steady = fem.roll(LAYER, roller, mix, 0.2, torque=torque, estimate=False)
    done = simulate_transient(LAYER, roller, mix, Accelerated(0.2, 0.0, 0.5), torque=torque, estimate=False)
    assert done.load == pytest.approx(steady.load, rel=1e-5)
    assert done.resistance == pytest.approx(steady.resistance, abs=1e-5 * steady.load)
    if torque is None and rolling == "sliding":
        assert done.angle is None
    else:
        assert R * done.angle[-1] / 0.1 - 1 == pytest.approx(steady.creep, rel=1e-5)


def test_drag_over_an_elastic_layer_turns_round_at_once():
    """It remembers nothing: every instant is steady rolling one way or the other."""
    mix, roller = Elastic(10e6, 0.3), pressed(friction=0.3, rolling="sliding")
    steady = fem.roll(LAYER, roller, mix, 1.0, estimate=False)
    done = simulate_transient(LAYER, roller, mix, law("harmonic", 0.1, 1.0).cycle(), estimate=False)
    turn = int(np.flatnonzero(np.diff(done.time) == 0)[-1])
    assert done.time[turn] == pytest.approx(1.0)
    assert done.resistance[1 : turn + 1] == pytest.approx(steady.resistance, rel=1e-6)
    assert done.resistance[turn + 1 :] == pytest.approx(-steady.resistance, rel=1e-6)
    assert done.load == pytest.approx(np.where(done.time > 0, steady.load, done.load), rel=1e-6)


def test_free_roller_from_rest_gets_as_steady_as_on_an_elastic_layer_both_ways():
    mix, roller = Elastic(10e6, 0.3), pressed(friction=0.3, rolling="free")
    steady = fem.roll(LAYER, roller, mix, 1.0, estimate=False)
    done = simulate_transient(LAYER, roller, mix, law("harmonic", 0.1, 1.0).cycle(), estimate=False)
    there, back = (int(np.argmin(np.abs(done.time - time))) for time in (1.0, 2.0))
    assert done.load[[there, back]] == pytest.approx(steady.load, rel=1e-4)
    assert done.resistance[there] == pytest.approx(steady.resistance, abs=1e-5 * steady.load)
    assert done.resistance[back] == pytest.approx(-steady.resistance, abs=1e-5 * steady.load)
    way = np.diff(done.position[there - 3 : there + 1])
    assert R * np.diff(done.angle[there - 3 : there + 1]) / way - 1 == pytest.approx(steady.creep, rel=0.01)


def test_torque_put_on_a_pressed_roller_makes_mindlins_shear():
    """Half of the friction limit at once: q = f p(x; a) - f (c/a) p(x; c), c = a sqrt(1 - 1/2), before the roller goes.

    R. D. Mindlin 1949, J. Appl. Mech. 16; Johnson 1985, eq (7.28). Poisson's ratio .49, lest pressure moves mix along.
    """
    mix, roller, motion = Elastic(10e6, 0.49), pressed(friction=0.3, rolling="driven"), law("quintic", 0.1, 1.0)
    torque = 0.5 * 0.3 * fem.roll(LAYER, pressed(), mix, 1.0, estimate=False).load * R
    problem = contact_problem.RollingProblem(LAYER, roller, mix, 0.0, torque)
    previous = transient._problem_before(problem, motion)
    grid = discretisation.initial_discretisation(previous, None, 1e-3)
    window = contact_problem.WINDOW * grid.half_width
    start, steps = transient._initial_state(problem, previous, grid, window, motion, 1e-3)
    contact = transient._reversed_state(replace(steps, problem=replace(problem, speed=1.0)), start).contact
    patch, shear = contact.patch, contact.shear
    x, a = shear.x - np.mean(patch.edges), (patch.leading - patch.trailing) / 2
    peak, c = 0.3 * patch.pressure.max(), a * np.sqrt(0.5)
    whole, stuck = (np.sqrt(np.maximum(1 - (x / half) ** 2, 0)) for half in (a, c))
    miss = np.abs(shear.traction + peak * (whole - c / a * stuck)) / peak
    assert np.mean(miss) < 3e-3
    assert np.max(miss) < 0.03  # at the one node where sticking ends
    assert shear.resultant[0] == pytest.approx(-torque / R / 10e6, rel=2e-3)


DAILY = (("parabola", 0.2), ("parabola", -3.0), ("circle", 0.003), ("deformed", 0.003), ("deformed", -3.0))


@pytest.mark.parametrize(
    ("profile", "speed"),
    [
        pytest.param(*case, marks=[pytest.mark.slow] * (case not in DAILY))
        for case in itertools.product(["parabola", "circle", "deformed"], [0.003, 0.2, -3.0])
    ],
)
def test_constant_speed_is_steady_rolling(profile, speed):
    steady = fem.roll(LAYER, pressed(profile=profile), MIX, speed, estimate=False)
    done = simulate_transient(
        LAYER, pressed(profile=profile), MIX, Accelerated(speed, 0.0, min(0.5, 0.15 / abs(speed))), estimate=False
    )
    assert done.resistance == pytest.approx(steady.resistance, rel=3e-3)
    assert done.load == pytest.approx(steady.load, rel=1e-3)
    edges = (steady.trailing, steady.leading) if speed > 0 else (-steady.leading, -steady.trailing)
    assert done.trailing == pytest.approx(edges[0], rel=5e-3)
    assert done.leading == pytest.approx(edges[1], rel=5e-3)


@pytest.mark.parametrize(
    ("layer", "mix"),
    [(Layer(0.22, "slip"), MIX), (Layer(0.22, plies=(Ply(0.17, 1.0), Ply(0.05, 3.0))), MIX), (LAYER, THREE)],
    ids=["slip", "plies", "three branches"],
)
def test_constant_speed_is_steady_rolling_on_every_layer(layer, mix):
    steady = fem.roll(layer, pressed(), mix, 0.1, estimate=False)
    done = simulate_transient(layer, pressed(), mix, Accelerated(0.1, 0.0, 0.5), estimate=False)
    assert done.resistance == pytest.approx(steady.resistance, rel=3e-3)


# order

REVERSAL = Accelerated(1.0, -1.0, 4.0)


def test_error_falls_with_the_square_of_the_steps():
    instants = (0.8, 1.2, 1.6, 2.0)
    motion, tolerances = Accelerated(1.0, -1.0, 2.0), (1.6e-2, 4e-3, 1e-3)
    coarse = [on_winkler(motion, instants, time_tolerance=each) for each in tolerances]
    _, exact, _ = on_winkler(motion, instants, time_tolerance=6e-5, estimate=False)
    largest = np.abs(coarse[-1][0].resistance).max() * 1e3
    errors = np.array([np.abs(force - exact).max() / largest for _, force, _ in coarse])
    steps = np.array([len(done.time) for done, _, _ in coarse])
    order = -np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert order > 1.5, f"error falls as n^-{order:.2f}"
    assert np.all(errors[1:] < errors[:-1] / 2)
    for error, (done, _, _) in zip(errors, coarse, strict=True):
        assert error < done.error < 10 * error


@pytest.mark.parametrize(
    ("rolling", "least"),
    [("sliding", 3.5), pytest.param("free", 1.7, marks=pytest.mark.slow)],
)
def test_halving_the_step_halves_the_error_with_friction_too(rolling, least):
    """Sliding it quarters it; the slip of a roller that turns is known at the ends of steps."""
    roller, motion = pressed(friction=0.3, rolling=rolling), law("quintic", 0.03, 0.25).cycle()
    forces = []
    for count in (20, 40, 80):
        instants = np.linspace(0, 0.5, count + 1)
        done = simulate_transient(LAYER, roller, MIX, motion, instants=instants, time_tolerance=10.0, estimate=False)
        at = [np.flatnonzero(np.abs(done.time - time) < 1e-9)[-1] for time in np.linspace(0, 0.5, 21)[1:]]
        forces.append(done.resistance[at])
    changes = [np.abs(fine - coarse).max() for coarse, fine in itertools.pairwise(forces)]
    assert changes[0] > least * changes[1]


# published numbers: tables of reference/contact.md e

TABLE = {  # t: (F, N), |err| < 2e-7 before rounding
    0.0: (0.10446, 0.95942),
    0.4: (0.10038, 0.93728),
    0.8: (0.08993, 0.88126),
    1.0: (0.07897, 0.84532),
    1.4: (0.03180, 0.77099),
    1.6: (-0.00483, 0.74272),
    2.0: (-0.07607, 0.74092),
    2.4: (-0.10787, 0.82717),
    3.0: (-0.08986, 0.99677),
    4.0: (-0.06638, 1.13341),
}


def test_reversal_on_a_winkler_foundation():
    _, resistance, load = on_winkler(REVERSAL, tuple(TABLE))
    forces, loads = np.array(list(TABLE.values())).T
    assert resistance == pytest.approx(forces, abs=2e-3 * forces[0])
    assert load == pytest.approx(loads, rel=3e-3)


@pytest.mark.parametrize(
    ("speed", "acceleration", "force"),
    [
        (0.1, -0.03, 0.06090090),
        (1.0, -0.3, 0.09690354),
        pytest.param(1.0, -0.03, 0.10355338, marks=pytest.mark.slow),
        pytest.param(1.0, 0.03, 0.10540707, marks=pytest.mark.slow),
        (3.0, -0.9, 0.05820110),
    ],
)
def test_constant_acceleration_on_a_winkler_foundation(speed, acceleration, force):
    duration = 8.0  # creep times are 2: what was before has faded to 0.02
    done, _, _ = on_winkler(Accelerated(speed - acceleration * duration, acceleration, duration), estimate=False)
    assert done.resistance[-1] * 1e3 == pytest.approx(force, rel=3e-3)


# hard cases: a program of another kind, joins, rest


def boundary_elements(mix, height, roller, motion, before, size, step):
    """t, F and P of a motion after steady rolling for a time `before`, on a bonded layer.

    The compliance of contact.md c by fast Fourier transform on a grid that lies on the layer, contact by an active set,
    even steps with the displacement linear in time at each place: no mesh, no edges, no moving frame.
    """
    law, n = creep_function(mix), 2 * int(10 * height / size)
    k, kappa = 2 * np.pi * np.fft.rfftfreq(n, size)[1:], 3 - 4 * mix.poisson
    zeta = np.minimum(k * height, 200)
    below = 2 * kappa * np.cosh(2 * zeta) + 4 * zeta**2 + 1 + kappa**2
    bulk = mix.youngs_modulus * (1 - mix.poisson) / ((1 + mix.poisson) * (1 - 2 * mix.poisson))
    symbol = 2 / mix.contact_modulus * (2 * kappa * np.sinh(2 * zeta) - 4 * zeta) / below / k
    symbol = np.insert(symbol, 0, height / bulk)
    kernel = np.fft.irfft(symbol, n)
    time = np.concatenate([np.arange(-before, -step / 2, step), np.arange(0, motion.duration + step / 2, step)])
    way = np.where(time < 0, motion.velocity(0.0) * time, motion.position(np.maximum(time, 0)))
    place = (np.arange(n) - n // 2) * size + (way.max() + way.min()) / 2
    shares, y = np.array(law.shares), step / np.array(law.times)
    new = 1 + np.expm1(-y) / y
    old = -np.expm1(-y) - new
    z, w, found = np.zeros((len(y), n)), np.zeros(n), []
    for at in way:
        z = np.exp(-y)[:, None] * z + old[:, None] * w
        near = np.flatnonzero(np.abs(place - at) < 1.6 * np.sqrt(2 * roller.radius * roller.indentation))
        arm = (place[near] - at) / roller.radius
        depth = roller.indentation - arm**2 * roller.radius / 2 - shares @ z[:, near]
        pressure = active_set((law.instant + shares @ new) * kernel[np.abs(near[:, None] - near)], depth)
        w = np.fft.irfft(np.fft.rfft(np.bincount(near, pressure, n)) * symbol, n)
        z = z + new[:, None] * w
        found.append((arm @ pressure * size, pressure.sum() * size))
    return time, *np.array(found).T


def active_set(A, depth):
    active = depth > 0
    for _ in range(60):
        pressure = np.zeros(len(depth))
        pressure[active] = np.linalg.solve(A[np.ix_(active, active)], depth[active])
        changed = np.where(active, pressure > 0, depth - A @ pressure > 0)
        if np.array_equal(changed, active):
            return pressure
        active = changed
    raise AssertionError("active set goes round")


@pytest.mark.parametrize(
    ("mix", "motion"),
    [
        pytest.param(MIX, Accelerated(0.2, -0.5, 1.0), marks=pytest.mark.slow),
        (MIX, Accelerated(0.2, -4.0, 0.16)),
        pytest.param(THREE, Accelerated(-0.1, 0.5, 0.6), marks=pytest.mark.slow),
        pytest.param(MIX, Accelerated(0.0, 0.5, 0.5), marks=pytest.mark.slow),
    ],
    ids=["gentle", "sharp", "three branches", "from rest"],
)
def test_boundary_elements_agree(mix, motion):
    roller = pressed(0.006)
    time, force, load = boundary_elements(mix, 0.22, roller, motion, before=2.0, size=1e-3, step=4e-3)
    done = simulate_transient(LAYER, roller, mix, motion)
    largest = np.abs(done.resistance).max()
    assert done.resistance == pytest.approx(np.interp(done.time, time, force), abs=5e-3 * largest)
    assert done.load == pytest.approx(np.interp(done.time, time, load), rel=2e-3)


def test_joins_of_the_law_are_not_stepped_over():
    cycle = law("gear-sector", 0.2, 1.0).cycle(far_dwell=0.1)
    done = simulate_transient(LAYER, pressed(), MIX, cycle, estimate=False)
    assert set(done.time) >= {join.time for join in cycle.discontinuities()} | {leg.start for leg in cycle.legs()}
    there = done.resistance[(done.time > 0.7) & (done.time < 1.0)]
    steady = fem.roll(LAYER, pressed(), MIX, 0.2, estimate=False).resistance
    assert there == pytest.approx(steady, rel=3e-3)


# the fields inside


@pytest.mark.parametrize("speed", [0.2, -0.2])
def test_frames_of_steady_motion_are_its_fields(speed):
    done = simulate_transient(LAYER, pressed(), MIX, Accelerated(speed, 0.0, 0.2), frames=(0.0, 0.2), estimate=False)
    steady = fem.fields(fem.roll(LAYER, pressed(), MIX, speed, estimate=False))
    u, stress = steady.point_data["displacement"], steady.cell_data["stress"][0]
    assert [time for time, _ in done.frames] == [0.0, 0.2]
    for time, mesh in done.frames:
        assert mesh.point_data["displacement"] == pytest.approx(u, abs=1e-3 * np.abs(u).max())
        assert mesh.cell_data["stress"][0] == pytest.approx(stress, abs=1e-3 * np.abs(stress).max())
        assert mesh.cell_data["position"][0] == pytest.approx(speed * time)


def test_frame_that_misses_a_join_by_rounding_is_kept():
    motion = law("gear-sector", 0.06, 0.3).cycle()
    done = simulate_transient(LAYER, pressed(), MIX, motion, frames=(3 * 0.1,), tolerance=1e-2, estimate=False)
    assert 3 * 0.1 != 0.3
    assert [time for time, _ in done.frames] == [0.3]


@pytest.mark.slow
def test_film_shows_the_print_that_the_roller_leaves(tmp_path):
    """Standing, then far away for a time: what is left at the start fades with the time of creep, 0.2 s."""
    motion = law("cubic", 0.2, 0.4).cycle(far_dwell=0.3)
    done = simulate_transient(LAYER, pressed(), MIX, motion, frames=(0.0, 0.4, 0.6), tolerance=1e-2, estimate=False)
    sunk = []
    for _, mesh in done.frames:
        x, y, _ = mesh.points.T
        place = x + mesh.cell_data["position"][0][0]
        at_start = np.flatnonzero((y == y.max()) & (np.abs(place) < 0.03))
        sunk.append(-mesh.point_data["displacement"][at_start, 1].min())
    assert sunk[0] == pytest.approx(0.003, rel=0.01)
    assert sunk[0] > sunk[1] > sunk[2] > 0
    series = done.write_frames(tmp_path)
    named = [part.attrib for part in ElementTree.parse(series).getroot().iter("DataSet")]
    assert [float(part["timestep"]) for part in named] == [0.0, 0.4, 0.6]
    assert all((tmp_path / part["file"]).stat().st_size > 10_000 for part in named)


# properties


@pytest.mark.parametrize("profile", ["parabola", pytest.param("deformed", marks=pytest.mark.slow)])
def test_motion_the_other_way_is_the_mirror_image(profile):
    there, back = (
        simulate_transient(
            LAYER, pressed(profile=profile), THREE, Accelerated(side * 0.1, side * -0.3, 0.5), estimate=False
        )
        for side in (1, -1)
    )
    assert back.time == pytest.approx(there.time)
    assert back.resistance == pytest.approx(-there.resistance, abs=1e-4 * np.abs(there.resistance).max())
    assert back.load == pytest.approx(there.load, rel=1e-5)
    assert back.leading == pytest.approx(-there.trailing, rel=1e-3)


@pytest.mark.slow
def test_work_of_the_roller_is_what_the_layer_keeps():
    """From rest to rest, all relaxed at last: no step of the way there gives more than all steps took before."""
    done = simulate_transient(LAYER, pressed(), THREE, law("cycloidal", 0.06, 0.5).cycle(), estimate=False)
    work = np.concatenate([[0], np.cumsum(np.diff(done.position) * (done.resistance[1:] + done.resistance[:-1]) / 2)])
    assert work[-1] > 0
    assert work.min() > -1e-3 * work[-1]


def test_free_roller_turns_back_without_a_jump():
    """What changes in the 2 ms after it is what relaxes anyway; drag would jump by 60 % of the load."""
    roller, motion = pressed(friction=0.3, rolling="free"), law("quintic", 0.05, 0.5).cycle()
    done = simulate_transient(LAYER, roller, MIX, motion, estimate=False)
    assert (np.diff(done.time) > 0).all()
    turn = int(np.argmin(np.abs(done.time - 0.5)))
    assert done.load[turn + 1] == pytest.approx(done.load[turn], rel=2e-3)
    assert done.resistance[turn + 1] == pytest.approx(done.resistance[turn], abs=5e-4 * done.load[turn])
    assert R * done.angle[turn] == pytest.approx(0.05, rel=0.1)  # less the creep


# cost


def test_stiffness_is_factorised_once_for_all_steps(monkeypatch):
    calls, splu = [], surface_compliance.splu
    monkeypatch.setattr(
        surface_compliance, "splu", lambda *given, **options: calls.append(1) or splu(*given, **options)
    )
    done = simulate_transient(Layer(0.205), pressed(), MIX, law("septic", 0.2, 1.5), estimate=False)
    assert len(calls) == 1
    assert done.steps < 80


# refusals


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"roller": Roller(R, load=1e4)}, "needs a roller with an `indentation`, got `load`"),
        ({"roller": pressed(friction=0.3, rolling="driven")}, "`torque` must be given for a 'driven' roller"),
        ({"torque": 10.0}, "`torque` needs a roller that is 'free' or 'driven'"),
        (
            {"layer": Layer(0.22, "slip"), "roller": pressed(friction=0.3, rolling="free")},
            "got `rolling` 'free'",
        ),
        ({"roller": pressed(profile="deformed"), "layer": Layer(0.22, "slip")}, "needs a vertical gap"),
        ({"time_tolerance": 0.0}, "`time_tolerance` must be positive"),
        ({"instants": (np.nan,)}, "`instants` must be finite"),
        ({"instants": (0.1, 2.0)}, "`instants` and `frames` must lie within the motion, 0 to 1 s, got 2.0"),
        ({"motion": Accelerated(0.1, 0.0, -1.0)}, "`duration` must be positive"),
        ({"motion": Accelerated(np.nan, 0.0, 1.0)}, "`position` must be finite"),
    ],
)
def test_refused(change, words):
    given = {"layer": LAYER, "roller": pressed(), "material": MIX, "motion": Accelerated(0.1, 0.0, 1.0)} | change
    with pytest.raises(ValueError, match=words):
        simulate_transient(**given)


def test_film_without_frames_is_refused(tmp_path):
    done = simulate_transient(LAYER, pressed(), MIX, Accelerated(0.1, 0.0, 0.05), estimate=False)
    with pytest.raises(ValueError, match="no frames to write"):
        done.write_frames(tmp_path)


def test_film_needs_a_mesh_of_straight_columns():
    even = mesh_for_error(0.22, 0.018, 1e-2)
    leaning = RowMesh(even.x + even.y[:, None] * 1e-3, even.y)
    with pytest.raises(ValueError, match="nodes lie in vertical columns"):
        simulate_transient(
            LAYER, pressed(), MIX, Accelerated(0.1, 0.0, 0.05), mesh=leaning, frames=(0.05,), estimate=False
        )


def test_number_that_is_lost_is_not_returned():
    time = np.linspace(0, 1, 3)
    with pytest.raises(RuntimeError, match=r"the resistance is not finite at t = 0\.5 s"):
        TransientResult(time, time, time, 1 + time, np.array([0.0, np.nan, 0.0]), time, time)
