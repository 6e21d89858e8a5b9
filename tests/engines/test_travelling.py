"""A roller that travels over compacting mix: against steady rolling, columns, its own balance, and at any speed."""

from dataclasses import replace

import numpy as np
import pytest

from compact.analysis.multipass import Pass, passes
from compact.engines.column import engine as column
from compact.engines.compaction.engine import roll
from compact.engines.compaction.reciprocating import ENTERED, Trip, simulate_reciprocating
from compact.engines.stroke_schedule import stroke_schedule
from compact.material.laws import Compaction
from compact.motion.profile import law
from compact.rolling_contact import Layer, Ply, Roller

# a small scene: 2 mm deep in 100 mm, the contact 21 mm long
MIX = Compaction(60e6, 0.3, 13e-6, 0.72, 1.2, 14e3, 0.94)
LAYER, ROLLER = Layer(0.1), Roller(0.11, 0.002, profile="deformed")
LENGTH = float(np.sqrt(2 * 0.11 * 0.002))
# a wide thin layer in small strain, which columns know: contact ten heights long
THIN = Compaction(20e6, 0.3, 13e-6, 0.72, 1.2, 14e3, 0.94, dry_side="ellipse")
HEIGHT = 0.02
DEPTH = 0.03 * HEIGHT
WIDE = Roller((10 * HEIGHT) ** 2 / (2 * DEPTH), DEPTH)
WIDE_LENGTH = 10 * HEIGHT


class Repeated:
    """So many strokes of a cycle."""

    def __init__(self, cycle, count):
        self.position, self.velocity = cycle.position, cycle.velocity
        self.duration = count * cycle.period / 2


def there_and_back(stroke, name="quintic", duration=2.0):
    return law(name, stroke, duration).cycle()


def columns_on_the_way(places):
    """Load and resistance of independent columns under a roller that comes down at the first place and goes to others.

    s_v along the curve of fresh mix where a column is pressed as never before, else elastic, and never below 0.
    """
    pressures = np.linspace(0, 220e3, 441)
    fresh = column.simulate_oedometer(THIN, pressures)
    stiffness = THIN.unloading_modulus * 0.7 / (1.3 * 0.4)  # (1 - nu)/((1 + nu)(1 - 2 nu)) of nu = 0.3
    x = np.linspace(-20 * HEIGHT, 40 * HEIGHT, 6001)
    deepest, forces = np.zeros_like(x), []
    for place in places:
        strain = (DEPTH - (x - place) ** 2 / (2 * WIDE.radius)) / HEIGHT
        deepest = np.maximum(deepest, strain)
        rebound = stiffness * np.log((1 - strain) / (1 - deepest))
        stress = np.maximum(np.interp(deepest, fresh.strain, pressures) - rebound, 0.0)
        forces.append([np.trapezoid(stress, x), np.trapezoid(stress * (x - place) / WIDE.radius, x)])
    return np.array(forces).T


class Mirrored:
    """The motion the other way."""

    def __init__(self, motion):
        self.motion, self.duration = motion, motion.duration

    def position(self, time):
        return -self.motion.position(time)

    def velocity(self, time):
        return -self.motion.velocity(time)


def over_thin(motion, material=THIN, roller=WIDE, **numerics):
    return simulate_reciprocating(
        Layer(HEIGHT), roller, material, motion, **({"increments": 4, "estimate": False} | numerics)
    )


def over_small(motion, **numerics):
    return simulate_reciprocating(LAYER, ROLLER, MIX, motion, **numerics)


@pytest.fixture(scope="module")
def thin():
    """There and back over the wide thin layer by one and a half contacts, each of twelve increments."""
    return over_thin(there_and_back(1.5 * WIDE_LENGTH), increments=12, estimate=True, instants=(0.0, 2.0, 4.0))


@pytest.fixture(scope="module")
def steady():
    return roll(LAYER, ROLLER, MIX, 0.2, increments=6)


@pytest.fixture(scope="module")
def cruising(steady):
    """There and back over the small layer, from steady motion on."""
    return over_small(there_and_back(5 * LENGTH), start=steady, estimate=False)


# (a) columns and steady rolling


def test_wide_thin_layer_goes_the_way_of_columns(thin):
    """Load and resistance at every step: 0.6 and 1.7 %, of which 0.5 and 1 % are the distance to two dimensions."""
    load, resistance = columns_on_the_way(thin.position)
    assert thin.load == pytest.approx(load, abs=0.01 * load.max())
    assert thin.resistance == pytest.approx(resistance, abs=0.02 * resistance.max())


def over_an_element(values):
    """Means of neighbours: the roller stands over corners and over middles of elements in turn."""
    return (values[1:] + values[:-1]) / 2


@pytest.mark.slow
def test_roller_from_rest_gets_as_steady_as_the_engine_of_steady_rolling(steady):
    told = over_small(law("constant-velocity", 0.25, 1.25), estimate=False)
    assert over_an_element(told.load)[-10:] == pytest.approx(steady.load, rel=5e-3)
    assert over_an_element(told.resistance)[-10:] == pytest.approx(steady.resistance, rel=5e-3)
    assert told.resistance[-10:] == pytest.approx(steady.resistance, rel=0.02)  # at each step
    assert told.density_ratio[0] == pytest.approx(steady.exit_density_ratio, abs=2e-4)


@pytest.mark.slow
def test_roller_that_comes_steadily_goes_on_so(cruising, steady):
    on = (cruising.stroke == 1) & (cruising.position > 2 * LENGTH)
    assert over_an_element(cruising.load[on]) == pytest.approx(steady.load, rel=5e-3)
    assert over_an_element(cruising.resistance[on]) == pytest.approx(steady.resistance, rel=5e-3)


@pytest.mark.slow
def test_feed_between_strokes_goes_as_passes_do():
    told = over_thin(Repeated(there_and_back(2 * WIDE_LENGTH), 2), increments=8, feed=HEIGHT)
    stages = Pass(), Pass(lift=HEIGHT, height=told.lowest[-1], forward=False)
    for stroke, rolled in enumerate(
        passes(Layer(HEIGHT), WIDE, THIN, 0.2, stages, engine="compaction", increments=8), 1
    ):
        last = np.flatnonzero(told.stroke == stroke)[-4:]
        assert told.load[last].mean() == pytest.approx(rolled.load, rel=5e-3)
        assert told.resistance[last].mean() == pytest.approx(rolled.resistance, rel=0.01)
        assert told.density_ratio[stroke - 1] == pytest.approx(rolled.exit_density_ratio, abs=2e-4)


def friction_free(friction=0.3, rolling="free"):
    return replace(WIDE, friction=friction, rolling=rolling)


@pytest.mark.parametrize("torque", [0.0, 2000.0], ids=["free", "driven"])
def test_roller_that_turns_gets_as_steady_as_the_engine_of_steady_rolling(torque):
    """Load, resistance and creep, in units of what friction makes: f times the contact over the radius."""
    told = over_thin(law("quintic", 2 * WIDE_LENGTH, 2.0), roller=friction_free(), increments=8, torque=torque)
    steady = roll(Layer(HEIGHT), friction_free(), THIN, 0.2, torque=torque, increments=8)
    assert over_an_element(told.load)[-6:] == pytest.approx(steady.load, rel=2e-3)
    # friction's share of the resistance is the torque's, 60 of 72 N/m less
    assert over_an_element(told.resistance)[-6:] == pytest.approx(steady.resistance, abs=5e-3 * 72)
    creep = WIDE.radius * np.diff(told.angle[-9:]) / np.diff(told.position[-9:]) - 1
    assert over_an_element(creep)[-6:] == pytest.approx(steady.creep, abs=0.01 * 0.3 * WIDE_LENGTH / WIDE.radius)
    assert told.work_residual < 5e-3


@pytest.mark.slow
def test_free_roller_on_a_high_layer_goes_on_as_steady_rolling():
    """Where friction moves the mix: creep of -0.069, 2 % of the load off."""
    roller = replace(ROLLER, friction=0.3, rolling="free")
    steady = roll(LAYER, roller, MIX, 0.2, increments=8)
    told = simulate_reciprocating(
        LAYER, roller, MIX, law("quintic", 2.5 * LENGTH, 1.0), start=steady, increments=8, estimate=False
    )
    assert over_an_element(told.load)[-6:] == pytest.approx(steady.load, rel=5e-3)
    assert over_an_element(told.resistance)[-6:] == pytest.approx(steady.resistance, rel=6e-3)
    creep = roller.radius * np.diff(told.angle[-9:]) / np.diff(told.position[-9:]) - 1
    assert over_an_element(creep)[-6:] == pytest.approx(steady.creep, rel=0.02)


# (b) order and balance


@pytest.fixture(scope="module")
def gripping():
    """The `Trip` of a free roller there and back, and of each step (stroke, push, slip of the nodes, stand)."""
    roller, way = friction_free(), stroke_schedule(there_and_back(WIDE_LENGTH))
    mesh = {"element": WIDE_LENGTH / 8, "length": WIDE_LENGTH, "finite": True}
    trip = Trip(way, roller, THIN, HEIGHT, fed=None, place=0.0, torque=None, **mesh)
    trip.press(HEIGHT - DEPTH, 1.0)
    steps = []
    for stroke in (0, 1):
        for place in way.steps(stroke, WIDE_LENGTH / 8)[1][1:]:
            before, left_at = trip.condition.displacement[trip.frame.surface], trip.face.offset
            trip.go(place, trip.face.lowest, 1.0)
            arc = trip.face._arcs(trip.condition.displacement[trip.frame.surface])
            came = replace(trip.face, offset=left_at)._arcs(before)
            steps.append((stroke, trip.push, arc - came + place - left_at + trip.push.ahead, trip.stand))
    return trip, steps


def test_free_roller_has_no_torque_and_keeps_to_coulombs_law(gripping):
    trip, steps = gripping
    weight = trip.face.weight
    for _, push, slip, stand in steps:
        assert abs(weight @ push.shear) < 1e-12 * stand.load
        assert (np.abs(push.shear) <= 0.3 * push.pressure * (1 + 1e-12)).all()
        slides = np.abs(push.shear) > 0.3 * push.pressure * (1 - 1e-9)
        assert np.where(slides, push.shear * slip, 0.0).max() <= 0.0  # against the slip
        # what sticks slips by no more than what the pressures may miss makes
        sticks = ~slides & (push.pressure > 0)
        assert np.abs(slip[sticks]).max() <= 1.01 * ENTERED * push.pressure.max() / trip.face.penalty


def test_slip_takes_work_and_all_work_is_accounted_for(gripping):
    _, steps = gripping
    rubbed, given, kept = (
        np.array([getattr(step[-1], name) for step in steps]) for name in ("rubbed", "given", "kept")
    )
    assert np.diff(rubbed).min() > -1e-3 * rubbed[-1]
    assert rubbed[-1] > 0
    assert np.abs(given - kept).max() < 5e-3 * given.max()


def test_friction_of_a_free_roller_turns_back_without_a_jump(gripping):
    _, steps = gripping
    k = next(i for i, step in enumerate(steps) if step[0] == 1)
    (_, before, _, there), (_, after, _, back) = steps[k - 1], steps[k]
    change = np.abs(after.shear - before.shear).max()
    assert change < 0.2 * np.abs(before.shear).max()
    assert back.load == pytest.approx(there.load, rel=0.1)
    assert (back.angle - there.angle) * WIDE.radius == pytest.approx(back.position - there.position, rel=1e-3)


@pytest.mark.slow
def test_halving_the_step_halves_the_change_at_least(thin):
    motion = there_and_back(1.5 * WIDE_LENGTH)
    rough, middle, fine = (
        _at_ends(run) for run in (over_thin(motion, increments=6), thin, over_thin(motion, increments=24))
    )
    for name in ("load", "resistance"):
        changes = [np.abs(a[name] - b[name]).max() for a, b in ((rough, middle), (middle, fine))]
        assert changes[1] < changes[0] / 2


def _at_ends(told, element=WIDE_LENGTH / 6):
    """Forces where the roller has gone by whole elements of the roughest mesh."""
    there = np.abs(told.position / element - np.round(told.position / element)) < 1e-6
    return {name: getattr(told, name)[there] for name in ("load", "resistance")}


def test_work_given_is_work_kept(thin):
    assert thin.work_residual < 5e-3
    assert thin.given[-1] > 0


# (d) hard cases


@pytest.mark.slow
def test_dwell_changes_nothing():
    motion = law("quintic", WIDE_LENGTH, 1.0)
    at_once, waiting = (over_thin(motion.cycle(far_dwell=dwell)) for dwell in (0.0, 3.0))
    assert waiting.resistance == pytest.approx(at_once.resistance, rel=1e-7)
    assert waiting.time[-1] == pytest.approx(at_once.time[-1] + 3.0)


# (e) properties


def test_mix_without_rate_knows_the_path_alone():
    slow, fast = (
        over_thin(there_and_back(WIDE_LENGTH, name, T)) for name, T in (("quintic", 50.0), ("parabolic", 0.1))
    )
    assert slow.position == pytest.approx(fast.position, abs=1e-12)
    assert slow.resistance == pytest.approx(fast.resistance, rel=1e-7)
    assert slow.load == pytest.approx(fast.load, rel=1e-7)


def test_rate_raises_the_forces_as_columns_say():
    rated = replace(THIN, rate_exponent=0.025, reference_speed=0.2)
    slow, fast = (over_thin(law("constant-velocity", WIDE_LENGTH, WIDE_LENGTH / speed), rated) for speed in (0.2, 2.0))
    usual, quick = (column.roll(Layer(HEIGHT), WIDE, rated, speed) for speed in (0.2, 2.0))
    assert fast.load[-1] / slow.load[-1] == pytest.approx(quick.load / usual.load, rel=5e-3)
    assert fast.resistance[-1] / slow.resistance[-1] == pytest.approx(quick.resistance / usual.resistance, rel=5e-3)


@pytest.mark.slow
def test_the_other_way_is_the_mirror_image():
    motion = there_and_back(WIDE_LENGTH)
    there, mirrored = over_thin(motion), over_thin(Mirrored(motion))
    assert mirrored.position == pytest.approx(-there.position, abs=1e-12)
    assert mirrored.load == pytest.approx(there.load, rel=1e-3)
    assert mirrored.resistance == pytest.approx(-there.resistance, abs=1e-3 * there.resistance.max())
    assert mirrored.leading == pytest.approx(-there.trailing, abs=1e-3 * WIDE_LENGTH)


@pytest.mark.slow
def test_sliding_roller_rubs_as_in_steady_motion_and_both_ways():
    roller = replace(WIDE, friction=0.3, rolling="sliding")
    steady = roll(Layer(HEIGHT), roller, THIN, 0.2, increments=8)
    told = over_thin(there_and_back(1.5 * WIDE_LENGTH), roller=roller, increments=8)
    cruise = np.flatnonzero(told.stroke == 1)[-4:]
    assert told.load[cruise].mean() == pytest.approx(steady.load, rel=0.01)
    assert told.resistance[cruise].mean() == pytest.approx(steady.resistance, rel=0.01)
    assert told.resistance[-1] < -0.3 * told.load[-1]
    assert told.work_residual < 0.01


@pytest.mark.slow
def test_way_back_over_pressed_mix_is_nearly_free(cruising, steady):
    back = cruising.resistance[(cruising.stroke == 2) & (cruising.position < 4 * LENGTH)]
    assert (back < 0).all()
    assert np.abs(back).max() < 0.1 * steady.resistance


@pytest.mark.slow
def test_strokes_with_feed_repeat_themselves():
    told = simulate_reciprocating(
        Layer(0.2), ROLLER, MIX, Repeated(there_and_back(0.1), 4), feed=0.05, increments=4, estimate=False
    )
    peaks = [np.abs(told.resistance[told.stroke == k]).max() for k in (1, 2, 3, 4)]
    assert np.abs(np.diff(peaks)).max() < 0.01 * peaks[0]
    assert told.work_residual < 0.02


def test_friction_that_vanishes_is_none():
    motion = there_and_back(WIDE_LENGTH / 2)
    slightly, smooth = over_thin(motion, roller=friction_free(1e-7)), over_thin(motion)
    assert slightly.load == pytest.approx(smooth.load, rel=1e-5)
    assert slightly.resistance == pytest.approx(smooth.resistance, abs=1e-5 * smooth.resistance.max())


@pytest.mark.slow
def test_free_roller_knows_the_path_alone():
    slow, fast = (
        over_thin(there_and_back(WIDE_LENGTH, name, T), roller=friction_free())
        for name, T in (("quintic", 50.0), ("parabolic", 0.1))
    )
    assert slow.resistance == pytest.approx(fast.resistance, abs=1e-7 * fast.resistance.max())
    assert slow.angle == pytest.approx(fast.angle, abs=1e-9)


@pytest.mark.slow
def test_free_roller_the_other_way_is_the_mirror_image():
    motion = there_and_back(WIDE_LENGTH)
    there, mirrored = (over_thin(each, roller=friction_free()) for each in (motion, Mirrored(motion)))
    assert mirrored.load == pytest.approx(there.load, rel=1e-3)
    assert mirrored.resistance == pytest.approx(-there.resistance, abs=1e-3 * there.resistance.max())
    assert mirrored.angle == pytest.approx(-there.angle, abs=1e-6)


def test_drag_of_a_sliding_roller_turns_round_where_it_stands():
    told = over_thin(there_and_back(WIDE_LENGTH), roller=friction_free(rolling="sliding"))
    before, after = np.flatnonzero(np.abs(told.time - 2.0) < 1e-2)[:2]
    assert told.position[before] == told.position[after]
    jump = told.resistance[before] - told.resistance[after]
    assert jump == pytest.approx(0.3 * (told.load[before] + told.load[after]), rel=1e-2)
    assert told.load[after] == pytest.approx(told.load[before], rel=0.05)
    assert told.work_residual < 0.02


# (f) cost and fields


def test_frames_are_those_asked_for(thin, tmp_path):
    times, meshes = zip(*thin.frames, strict=True)
    assert times == pytest.approx([0.0, 2.0, 4.0], abs=0.01)
    assert [mesh.cell_data["density_ratio"][0].max() for mesh in meshes] == sorted(
        mesh.cell_data["density_ratio"][0].max() for mesh in meshes
    )
    assert thin.write_frames(tmp_path).exists()


def test_steps_take_few_iterations(thin):
    assert thin.iterations < 8 * len(thin.time)


# (g) refusals


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"roller": Roller(0.11, load=5e3)}, "give its `indentation`, got its load"),
        ({"layer": Layer(0.1, "slip")}, "`base` must be 'bonded'"),
        ({"layer": Layer(0.1, plies=(Ply(0.05, 1.0), Ply(0.05, 2.0)))}, "`plies` are for linear layers"),
        ({"roller": replace(ROLLER, friction=0.3, rolling="driven")}, "`torque` must be given for a 'driven' roller"),
        ({"torque": 10.0}, "`torque` needs a roller that is 'free' or 'driven'"),
        ({"material": "mix"}, "`material` must be Compaction, got str"),
        ({"feed": -0.01}, "`feed` must be zero or positive"),
        ({"feed": 0.02}, "`feed` must be more than 0.03333 m"),
        ({"increments": 0.5}, "`increments` must be a whole number"),
        ({"instants": (np.nan,)}, "`instants` must be finite"),
        ({"roller": replace(ROLLER, indentation=0.01)}, "would press mix"),
    ],
)
def test_refuses(changes, words):
    given = {"layer": LAYER, "roller": ROLLER, "material": MIX, "motion": law("quintic", 0.1, 1.0)} | changes
    with pytest.raises(ValueError, match=words):
        simulate_reciprocating(**given)


def test_torque_beyond_the_friction_limit_skids():
    with pytest.raises(RuntimeError, match=r"the roller skids at .*times the friction limit asked"):
        over_thin(law("quintic", WIDE_LENGTH / 4, 1.0), roller=friction_free(1e-3), torque=60.0 * WIDE.radius)


@pytest.mark.slow
def test_refuses_a_start_elsewhere(steady):
    with pytest.raises(ValueError, match="`start` must have rolled over the same `layer`"):
        simulate_reciprocating(Layer(0.2), ROLLER, MIX, law("quintic", 0.1, 1.0), start=steady)
    with pytest.raises(ValueError, match="`start` must roll along \\+x, and the `motion` begin that way"):
        over_small(Mirrored(law("quintic", 0.1, 1.0)), start=steady)
