"""Reciprocating roller over compacting mix, against steady rolling, columns and its own energy balance."""

from dataclasses import replace

import numpy as np
import pytest
from mixes import THIN

from compact.analysis.contact_cases import Pass, passes
from compact.engines.column import engine as column
from compact.engines.compaction.engine import roll
from compact.engines.compaction.reciprocating import MULTIPLIER_TOLERANCE, ReciprocatingRoller, simulate_reciprocating
from compact.engines.compaction.roller_frame import RollerFrame, rolling_mesh
from compact.engines.stroke_schedule import TURN_STEP_ENDS, stroke_schedule
from compact.motion.profile import LAWS, law
from compact.rolling_contact import Layer, Roller

LENGTH = float(np.sqrt(2 * 0.11 * 0.002))  # contact length on the high layer
# wide thin layer, for which columns are accurate: contact length ahead of ten heights
HEIGHT = 0.02
DEPTH = 0.03 * HEIGHT
WIDE = Roller((10 * HEIGHT) ** 2 / (2 * DEPTH), indentation=DEPTH)
WIDE_LENGTH = 10 * HEIGHT


class RepeatedMotion:
    """A number of strokes of a cycle."""

    def __init__(self, cycle, count):
        self.position, self.velocity = cycle.position, cycle.velocity
        self.duration = count * cycle.period / 2


def two_strokes(stroke, name="quintic", duration=2.0):
    return law(name, stroke, duration).cycle()


def free_roller(friction=0.3, rolling="free"):
    return replace(WIDE, friction=friction, rolling=rolling)


def simulate_thin(motion, material=THIN, roller=WIDE, **options):
    defaults = {"increments": 4, "estimate": False}
    return simulate_reciprocating(Layer(HEIGHT), roller, material, motion, **defaults | options)


def element_means(values):
    """Means of the four steps of an element, as of steady rolling."""
    return np.convolve(values, np.full(4, 1 / 4), "valid")


def column_forces(positions):
    """Load and resistance of independent columns under a roller pressed at the first position and moved to others.

    s_v follows the curve of fresh mix at the largest strain of a column, is elastic below it, and never negative.
    """
    pressures = np.linspace(0, 220e3, 441)
    fresh = column.simulate_oedometer(THIN, pressures)
    stiffness = THIN.unloading_modulus * 0.7 / (1.3 * 0.4)  # (1 - nu)/((1 + nu)(1 - 2 nu)) of nu = 0.3
    x = np.linspace(-20 * HEIGHT, 40 * HEIGHT, 6001)
    largest, forces = np.zeros_like(x), []
    for position in positions:
        strain = (DEPTH - (x - position) ** 2 / (2 * WIDE.radius)) / HEIGHT
        largest = np.maximum(largest, strain)
        recovery = stiffness * np.log((1 - strain) / (1 - largest))
        stress = np.maximum(np.interp(largest, fresh.strain, pressures) - recovery, 0.0)
        forces.append([np.trapezoid(stress, x), np.trapezoid(stress * (x - position) / WIDE.radius, x)])
    return np.array(forces).T


@pytest.fixture(scope="module", params=[8, pytest.param(12, marks=pytest.mark.slow)])
def thin(request):
    """Two strokes of one and a half contact lengths over the wide thin layer."""
    return simulate_thin(two_strokes(1.5 * WIDE_LENGTH), increments=request.param, instants=(0.0, 2.0, 4.0))


@pytest.fixture(scope="module")
def steady(layer, roller, mix):
    return roll(layer, roller, mix, 0.2, increments=6)


@pytest.fixture(scope="module")
def from_steady(steady, layer, roller, mix):
    """Two strokes over the high layer from steady motion."""
    return simulate_reciprocating(layer, roller, mix, two_strokes(5 * LENGTH), start=steady, estimate=False)


# (a) columns and steady rolling


def test_wide_thin_layer_follows_columns(thin):
    """With 12 increments within 0.6 % of load and 1.7 % of resistance; 0.5 and 1 % are the effect of two dimensions."""
    load, resistance = column_forces(thin.position)
    assert thin.load == pytest.approx(load, abs=0.015 * load.max())
    assert thin.resistance == pytest.approx(resistance, abs=0.03 * resistance.max())


@pytest.mark.slow
def test_roller_from_rest_becomes_steady(layer, roller, mix):
    """Twenty contact lengths, the relaxation length of the wave, on a mesh of its own."""
    steady = roll(layer, roller, mix, 0.2)
    run = simulate_reciprocating(layer, roller, mix, law("constant-velocity", 0.45, 2.25), estimate=False)
    (load_error, resistance_error), on_mesh = steady.error, steady.load / steady.load_factor
    assert element_means(run.load)[-10:] == pytest.approx(on_mesh, rel=load_error)
    assert element_means(run.resistance)[-10:] == pytest.approx(steady.resistance, rel=resistance_error)
    assert np.all(np.less(steady.error, (0.012, 0.016)))  # with that by the elements
    assert run.resistance[-10:] == pytest.approx(steady.resistance, rel=0.02)  # of each step
    assert run.density_ratio[0] == pytest.approx(steady.exit_density_ratio, abs=2e-4)


@pytest.mark.slow
def test_steady_motion_continues(from_steady, steady):
    """Both differ by the error of steady rolling."""
    (load_error, resistance_error), on_mesh = steady.error, steady.load / steady.load_factor
    steps = (from_steady.stroke == 1) & (from_steady.position > 2 * LENGTH)
    assert element_means(from_steady.load[steps]) == pytest.approx(on_mesh, rel=load_error)
    assert element_means(from_steady.resistance[steps]) == pytest.approx(steady.resistance, rel=resistance_error)


@pytest.mark.slow
def test_lifts_between_strokes_agree_with_passes():
    run = simulate_thin(RepeatedMotion(two_strokes(2 * WIDE_LENGTH), 2), increments=8, lift_thickness=HEIGHT)
    stages = Pass(), Pass(lift=HEIGHT, height=run.bottom_height[-1], forward=False)
    results = passes(Layer(HEIGHT), WIDE, THIN, 0.2, stages, engine="compaction", increments=8)
    for stroke, rolled in enumerate(results, 1):
        last = np.flatnonzero(run.stroke == stroke)[-4:]
        assert run.load[last].mean() == pytest.approx(rolled.load, rel=5e-3)
        assert run.resistance[last].mean() == pytest.approx(rolled.resistance, rel=0.01)
        assert run.density_ratio[stroke - 1] == pytest.approx(rolled.exit_density_ratio, abs=2e-4)


@pytest.mark.parametrize("torque", [pytest.param(0.0, marks=pytest.mark.slow), 2000.0], ids=["free", "driven"])
def test_rotating_roller_becomes_steady(torque):
    """Tolerances of resistance and creepage are relative to the effect of friction, f times contact over radius."""
    run = simulate_thin(law("quintic", 2 * WIDE_LENGTH, 2.0), roller=free_roller(), increments=8, torque=torque)
    steady = roll(Layer(HEIGHT), free_roller(), THIN, 0.2, torque=torque, increments=8)
    assert element_means(run.load)[-6:] == pytest.approx(steady.load, rel=2e-3)
    # the torque reduces the resistance by 60 of 72 N/m
    assert element_means(run.resistance)[-6:] == pytest.approx(steady.resistance, abs=0.005 * 72)
    creepage = WIDE.radius * np.diff(run.angle[-10:]) / np.diff(run.position[-10:]) - 1
    assert element_means(creepage)[-6:] == pytest.approx(steady.creep, abs=0.01 * 0.3 * WIDE_LENGTH / WIDE.radius)
    assert run.work_residual < 5e-3


# (b) order and balance


@pytest.fixture(scope="module")
def free_strokes():
    """Free roller over two strokes; of each step the stroke, contact, slip of the nodes and roller state."""
    strokes = stroke_schedule(two_strokes(WIDE_LENGTH))
    element = WIDE_LENGTH / 8
    mesh = rolling_mesh(HEIGHT, WIDE_LENGTH, element, stroke=round(strokes.span / element))
    roller = ReciprocatingRoller(RollerFrame(mesh, THIN, "bonded", WIDE_LENGTH), free_roller(), strokes)
    roller.press(HEIGHT - DEPTH, 1.0)
    steps = []
    for stroke in (0, 1):
        for position in strokes.steps(stroke, element)[1][1:]:
            surface, nodes = roller.surface, roller.frame.surface_nodes
            arcs_before, start = surface.arcs(roller.state.displacement[nodes]), surface.position
            roller.move_to(position, surface.bottom_height, 1.0)
            slip = roller.surface.arcs(roller.state.displacement[nodes]) - arcs_before + position - start
            steps.append((stroke, roller.contact, slip + roller.contact.creep_travel, roller.record))
    return roller, steps


def test_free_roller_has_no_torque_and_satisfies_coulombs_law(free_strokes):
    roller, steps = free_strokes
    for _, contact, slip, state in steps:
        assert abs(roller.surface.weights @ contact.shear) < 1e-12 * state["load"]
        assert (np.abs(contact.shear) <= 0.3 * contact.pressure * (1 + 1e-12)).all()
        slipping = np.abs(contact.shear) > 0.3 * contact.pressure * (1 - 1e-9)
        assert np.where(slipping, contact.shear * slip, 0.0).max() <= 0.0  # against the slip
        sticking = ~slipping & (contact.pressure > 0)
        tolerance = 1.01 * MULTIPLIER_TOLERANCE * contact.pressure.max() / roller.surface.penalty
        assert np.abs(slip[sticking]).max() <= tolerance


def test_slip_dissipates_work_and_all_work_balances(free_strokes):
    _, steps = free_strokes
    names = ("slip_work", "input_work", "stored_work")
    slip, supplied, stored = (np.array([step[-1][name] for step in steps]) for name in names)
    assert np.diff(slip).min() > -1e-3 * slip[-1]
    assert slip[-1] > 0
    assert np.abs(supplied - stored).max() < 5e-3 * supplied.max()


def test_friction_of_a_free_roller_is_continuous_at_a_reversal(free_strokes):
    _, steps = free_strokes
    k = next(i for i, step in enumerate(steps) if step[0] == 1)
    (_, before, _, there), (_, after, _, back) = steps[k - 1], steps[k]
    assert np.abs(after.shear - before.shear).max() < 0.2 * np.abs(before.shear).max()
    assert back["load"] == pytest.approx(there["load"], rel=0.1)
    assert (back["angle"] - there["angle"]) * WIDE.radius == pytest.approx(
        back["position"] - there["position"], rel=1e-3
    )


def test_input_work_is_stored_and_frames_are_kept(thin):
    assert thin.work_residual < 5e-3
    assert thin.input_work[-1] > 0
    assert thin.iterations < 8 * len(thin.time)
    times, meshes = zip(*thin.frames, strict=True)
    assert times == pytest.approx([0.0, 2.0, 4.0], abs=0.01)
    densities = [mesh.cell_data["density_ratio"][0].max() for mesh in meshes]
    assert densities == sorted(densities)


# (d) properties


@pytest.mark.parametrize("roller", [WIDE, pytest.param(free_roller(), marks=pytest.mark.slow)], ids=["smooth", "free"])
def test_mix_without_rate_effect_depends_on_the_path_alone(roller):
    motions = law("quintic", WIDE_LENGTH / 2, 50.0), law("parabolic", WIDE_LENGTH / 2, 0.1)
    slow, fast = (simulate_thin(motion.cycle(), roller=roller) for motion in motions)
    assert slow.position == pytest.approx(fast.position, abs=1e-12)
    assert slow.resistance == pytest.approx(fast.resistance, abs=1e-7 * fast.resistance.max())
    assert slow.load == pytest.approx(fast.load, rel=1e-7)
    assert slow.angle == pytest.approx(fast.angle, abs=1e-9)


def test_rate_effect_agrees_with_columns():
    rated = replace(THIN, rate_sensitivity=0.03)
    slow, fast = (
        simulate_thin(law("constant-velocity", WIDE_LENGTH, WIDE_LENGTH / speed), rated) for speed in (0.2, 2.0)
    )
    reference, quick = (column.roll(Layer(HEIGHT), WIDE, rated, speed) for speed in (0.2, 2.0))
    assert fast.load[-1] / slow.load[-1] == pytest.approx(quick.load / reference.load, rel=5e-3)
    assert fast.resistance[-1] / slow.resistance[-1] == pytest.approx(quick.resistance / reference.resistance, rel=5e-3)


@pytest.mark.slow
def test_sliding_roller_becomes_steady_in_both_directions():
    roller = free_roller(rolling="sliding")
    steady = roll(Layer(HEIGHT), roller, THIN, 0.2, increments=8)
    run = simulate_thin(two_strokes(1.5 * WIDE_LENGTH), roller=roller, increments=8)
    last = np.flatnonzero(run.stroke == 1)[-4:]
    assert run.load[last].mean() == pytest.approx(steady.load, rel=0.01)
    assert run.resistance[last].mean() == pytest.approx(steady.resistance, rel=0.01)
    assert run.resistance[-1] < -0.3 * run.load[-1]
    assert run.work_residual < 0.01


def test_friction_of_a_sliding_roller_changes_sign_at_rest():
    run = simulate_thin(two_strokes(WIDE_LENGTH / 2), roller=free_roller(rolling="sliding"))
    before, after = np.flatnonzero(np.abs(run.time - 2.0) < 1e-2)[:2]
    assert run.position[before] == run.position[after]
    jump = run.resistance[before] - run.resistance[after]
    assert jump == pytest.approx(0.3 * (run.load[before] + run.load[after]), rel=1e-2)
    assert run.load[after] == pytest.approx(run.load[before], rel=0.05)
    assert run.work_residual < 0.02


def test_mix_laid_behind_the_roller_is_met_after_its_own_track():
    """On its own track a few percent of the resistance; a contact length beyond the edge that of fresh mix.

    This stiff, wide contact lets go over a quarter of its length. The mesh of 6 increments scatters by 2 %.
    """
    motion = law("constant-velocity", 2 * WIDE_LENGTH, 2.0).cycle()
    run = simulate_thin(motion, increments=6, edge_distance=1.5 * WIDE_LENGTH)
    end, back = np.flatnonzero(run.stroke == 1)[-1], run.stroke == 2
    travel, force = run.position[end] - run.position[back], -element_means(run.resistance)[-back.sum() :]
    fresh = element_means(run.resistance)[end - 3]  # the last element
    assert np.abs(force[(travel > 0.25 * WIDE_LENGTH) & (travel < 0.4 * WIDE_LENGTH)]).max() < 0.06 * fresh
    assert force[travel > 1.6 * WIDE_LENGTH] == pytest.approx(fresh, rel=0.03)


# (f) refusals


class MirroredMotion:
    """A motion in the opposite direction."""

    def __init__(self, motion):
        self.motion, self.duration = motion, motion.duration

    def position(self, time):
        return -self.motion.position(time)

    def velocity(self, time):
        return -self.motion.velocity(time)


def _forces_at_elements(run, element=WIDE_LENGTH / 6):
    """Forces after whole elements of the coarsest mesh."""
    whole = np.abs(run.position / element - np.round(run.position / element)) < 1e-6
    return {name: getattr(run, name)[whole] for name in ("load", "resistance")}


@pytest.mark.slow
def test_halving_the_step_halves_the_change_at_least():
    motion = two_strokes(1.5 * WIDE_LENGTH)
    rough, middle, fine = (_forces_at_elements(simulate_thin(motion, increments=n)) for n in (6, 12, 24))
    for name in ("load", "resistance"):
        changes = [np.abs(a[name] - b[name]).max() for a, b in ((rough, middle), (middle, fine))]
        assert changes[1] < changes[0] / 2


@pytest.mark.slow
@pytest.mark.parametrize("roller", [WIDE, free_roller()], ids=["smooth", "free"])
def test_opposite_motion_is_the_mirror_image(roller):
    motion = two_strokes(WIDE_LENGTH)
    run, mirrored = (simulate_thin(each, roller=roller) for each in (motion, MirroredMotion(motion)))
    assert mirrored.position == pytest.approx(-run.position, abs=1e-12)
    assert mirrored.load == pytest.approx(run.load, rel=1e-3)
    assert mirrored.resistance == pytest.approx(-run.resistance, abs=1e-3 * run.resistance.max())
    assert mirrored.leading == pytest.approx(-run.trailing, abs=1e-3 * WIDE_LENGTH)
    assert mirrored.angle == pytest.approx(-run.angle, abs=1e-6)


@pytest.mark.slow
def test_return_stroke_over_compacted_mix_has_little_resistance(from_steady, steady):
    back = from_steady.resistance[(from_steady.stroke == 2) & (from_steady.position < 4 * LENGTH)]
    assert (back < 0).all()
    assert np.abs(back).max() < 0.1 * steady.resistance


@pytest.mark.slow
def test_dwell_has_no_effect():
    motion = law("quintic", WIDE_LENGTH, 1.0)
    without, with_dwell = (simulate_thin(motion.cycle(far_dwell=dwell)) for dwell in (0.0, 3.0))
    zero = 1e-8 * without.resistance.max()  # the resistance changes its sign
    assert with_dwell.resistance == pytest.approx(without.resistance, rel=1e-7, abs=zero)
    assert with_dwell.time[-1] == pytest.approx(without.time[-1] + 3.0)


@pytest.mark.slow
def test_strokes_with_lifts_repeat(roller, mix):
    motion = RepeatedMotion(two_strokes(0.1), 4)
    run = simulate_reciprocating(Layer(0.2), roller, mix, motion, lift_thickness=0.05, increments=4, estimate=False)
    peaks = [np.abs(run.resistance[run.stroke == k]).max() for k in (1, 2, 3, 4)]
    assert np.abs(np.diff(peaks)).max() < 0.01 * peaks[0]
    assert run.work_residual < 0.02


def test_vanishing_friction_has_no_effect():
    motion = law("quintic", WIDE_LENGTH / 2, 2.0)
    slight, none = simulate_thin(motion, roller=free_roller(1e-7)), simulate_thin(motion)
    assert slight.load == pytest.approx(none.load, rel=1e-5)
    assert slight.resistance == pytest.approx(none.resistance, abs=1e-5 * none.resistance.max())


# ---- Strokes between reversals, and the positions at which time steps end


@pytest.mark.parametrize("name", [name for name in LAWS if name != "crank"])
def test_every_cycle_has_a_forward_and_a_return_stroke(name):
    motion = law(name, 0.4, 3.0)
    assert stroke_schedule(motion).places == pytest.approx([0.0, 0.4], abs=1e-12)
    assert stroke_schedule(motion.cycle()).places == pytest.approx([0.0, 0.4, 0.0], abs=1e-12)
    assert stroke_schedule(motion.cycle()).times == pytest.approx([0.0, 3.0, 6.0], abs=1e-3)


def test_reversal_between_discontinuities_is_found():
    class Swing:
        duration = 2.0

        def position(self, time):
            return np.sin(3 * np.asarray(time))

    way = stroke_schedule(Swing())
    assert way.places == pytest.approx([0.0, 1.0, -1.0, np.sin(6.0)], abs=1e-12)
    assert way.times[1:-1] == pytest.approx([np.pi / 6, np.pi / 2], abs=1e-6)
    assert (way.low, way.span) == pytest.approx((-1.0, 2.0))


def test_steps_end_at_fractions_of_elements():
    motion = law("quintic", 0.1, 1.0)
    times, places = stroke_schedule(motion).steps(0, 0.01)
    assert places[:7] == pytest.approx(0.01 * np.append(0.0, TURN_STEP_ENDS))
    assert np.diff(places[6:]) == pytest.approx(0.0025)
    assert places[-1] == pytest.approx(0.1)
    assert motion.position(times) == pytest.approx(places, abs=1e-9)


def test_stroke_starts_at_the_end_of_a_dwell():
    way = stroke_schedule(law("quintic", 0.1, 1.0).cycle(far_dwell=0.5))
    times, _ = way.steps(1, 0.01)
    assert times[0] == pytest.approx(1.5, abs=2e-3)
    assert way.steps(0, 0.01)[0][-1] == pytest.approx(1.0, abs=1e-3)
