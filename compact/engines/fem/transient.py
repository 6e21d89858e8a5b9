"""The engine "fem" through time: a roller of changing speed on an elastic or viscoelastic layer.

The mesh goes with the roller, what the mix remembers stays with the mix. With s(t) the way of the roller, branch k of
the creep function, see `streamline`, follows at every place X of the layer

    theta_k dz_k/dt + z_k = w(X - s(t), t),    u = J_0 w + sum J_k z_k,

w the displacement of the elastic layer as seen from the roller. During a time step w is taken linear in time at each x
under the roller, and what fades is summed along the way s(t) itself:

    z_k <- exp(-T/theta_k) z_k + int exp(-(T - t)/theta_k) [(1 - t/T) w_old + (t/T) w_new](X - s(t)) dt/theta_k

Steady motion is met exactly by steps of any length, and v = 0 is a place like any other. What is known of z stands as a
surface set aside, what is sought as a response: every step is one contact on the layer that was condensed once. Steps
are of second order; their length follows from how far the forces leave their own tangent.

A roller that turns with friction sticks and slips by Coulomb's law on the slip at the end of a step (`stickslip.Grip`),
du/dt taken as seen from the roller: exact in steady motion too, of first order else. Where it turns back nothing jumps.
The traction of a roller that slides, and a torque, turn round at once where it turns; there the time stands twice.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from threadpoolctl import threadpool_limits

from compact.engines.fem import engine as fem_engine
from compact.engines.fem.contact_patch import BeyondWindowError, Surface, interpolation, press
from compact.engines.fem.convected_memory import Creep, creep, fading_over, retained_by, steadily_retained, within
from compact.engines.fem.stick_slip import FrictionCondition, pressed_and_sheared
from compact.engines.stroke_schedule import smooth_intervals
from compact.material.laws import Elastic
from compact.mesh import DEFAULT_ERROR
from compact.numerics.validation import require_finite, require_positive
from compact.rolling_contact import TransientResult, require_torque_allowed

TIME_TOLERANCE = 1e-3  # of int p |x| dx/R, by which steps in time may miss the resistance
PLACES = 40  # of the layer, and instants of the way, per half-width
FEWEST = 4  # instants of the way in a step
LONGEST = 2.0  # half-widths travelled in a step
FIRST = 0.02  # of the shortest time of creep, after the law has jumped
SHORTEST = 1e-3  # of the same: shorter steps would only see the mesh
SAME = 1e-9  # of the duration: instants closer than this are one
GROWING, SHRINKING = 2.0, 0.25  # ratio of a step to the one before, at most and at least
SAFE = 0.9  # of the step that would meet the tolerance


def simulate_transient(
    layer, roller, material, motion, *, torque=None, instants=(), frames=(), mesh=None, tolerance=DEFAULT_ERROR,
    time_tolerance=TIME_TOLERANCE, estimate=True,
):  # fmt: skip
    """A roller in any motion at a given indentation over a linear layer, a `TransientResult`.

    Before the motion the roller has kept its first velocity for ever: it comes in steady rolling, or has stood.

    Parameters
    ----------
    layer : Layer, of any height and plies
    roller : Roller, every profile; "sliding" with the traction f p on the mix along the travel, "free" or "driven",
        which stick and slip. Over a slipping layer without friction, and with a gap that is vertical
    material : Elastic or Viscoelastic
    motion : with `position` and `velocity` of time, and `duration` [s]; no step passes its `joins`
    torque : on a roller that is free or driven, per unit length, + turning it the way it travels [N]; without it a
        free roller has none
    instants : times at which a step shall end [s]
    frames : times of which to keep the fields inside [s], for `TransientResult.write_frames`
    mesh, tolerance : as of `fem_engine.roll`
    time_tolerance : of int p |x| dx/R, by which the steps in time may miss the resistance
    estimate : whether to tell the error of the steps, from steps twice as long; half as much work again

    >>> from compact.material.laws import Viscoelastic
    >>> from compact.motion.profile import law
    >>> from compact.rolling_contact import Layer, Roller
    >>> mix = Viscoelastic(10e6, 0.3, branches=((1.0, 0.1),))
    >>> stroke = law("quintic", stroke=0.1, duration=1.0)
    >>> done = travel(Layer(0.22), Roller(0.11, indentation=0.003), mix, stroke)
    >>> f"{done.resistance.max():.0f} N/m at most, within {100 * done.error:.1f} % for the steps"
    '505 N/m at most, within 0.1 % for the steps'
    """
    _refuse(layer, roller, material, motion, mesh, tolerance, time_tolerance, (*instants, *frames))
    require_torque_allowed(roller, torque)
    case = fem_engine.Case(layer, roller, material, float(np.sign(_first_velocity(motion))), torque or 0.0)
    drags = roller.friction > 0 and roller.rolling != "frictionless"
    breaks = smooth_intervals(motion, turns=drags)
    instants, frames = _rounded(instants, breaks), _rounded(frames, breaks)
    with threadpool_limits(1):  # matrices are small, threads only quarrel
        first = _before(case, motion)
        task = fem_engine.task_of(first, mesh, tolerance)

        def marched(window):
            start, pace = _begun(case, first, task, window, motion, time_tolerance)
            path = _marched(pace, start, breaks, sorted({*breaks, *instants, *frames}))
            return (path, pace), _judged(pace, start, breaks, _every_second(path, breaks)) if estimate else None

        (path, pace), judge = fem_engine.widening(task, marched)
        taken = ()
        if frames:
            from compact.engines.fem.fields import filmed

            velocity = _first_velocity(motion)
            taken = filmed(layer, material, task.mesh, path, pace.way, velocity, frames)
    return _travelled(path, judge, case, motion, taken)


@dataclass(frozen=True, eq=False)
class Pace:
    """What all steps share: the elastic surface, the case, the creep, the motion, and lengths to go by.

    The speed of the case is 1 or -1 for the way of the roller, 0 as long as it has stood.
    """

    surface: Surface
    case: fem_engine.Case
    terms: int
    law: Creep
    motion: object
    half_width: float
    tolerance: float

    @property
    def roll(self):
        return self.case.pressed(self.case.roller.indentation)

    @property
    def set_valued(self):
        """Whether the roller drags or is turned one way or the other, and at rest anything between."""
        return bool(self.case.friction or (self.case.sticks and self.case.torque))

    def grip(self, velocity, interval, aside, before):
        """The `FrictionCondition` of a roller that turns, on a surface that stands aside and stood elsewhere an interval before."""
        case, direction = self.case, self.case.speed or 1.0
        asked = -direction * case.torque / case.roller.radius / case.material.youngs_modulus
        return FrictionCondition(case.roller.friction, asked, direction, velocity, 1 / interval, aside, before)

    @property
    def quickest(self):
        """Shortest time of creep; the duration of the motion where nothing creeps [s]."""
        return min(self.law.times, default=self.motion.duration)

    def way(self, begin, end):
        """Positions at even instants from one time to another, close enough for the contact, shape (n + 1,)."""
        rough = self.motion.position(np.linspace(begin, end, 2 * PLACES + 1))
        count = max(FEWEST, int(np.ceil(np.abs(np.diff(rough)).sum() * PLACES / self.half_width)))
        return self.motion.position(np.linspace(begin, end, count + 1))


@dataclass(frozen=True, eq=False)
class Instant:
    """Where the roller is and its angle, the contact it makes, w of the surface, shape (2, n), and z of the `places`,
    (k, 2, m)."""

    time: float
    position: float
    contact: fem_engine.Contact
    displacement: np.ndarray
    places: np.ndarray
    retained: np.ndarray
    angle: float = 0.0

    @property
    def moment(self):
        """Forces on the nodes times |x|/R."""
        surface, roll = self.contact.surface, self.contact.roll
        return self.contact.forces * np.abs(surface.x) / roll.radius


def _before(case, motion):
    """The `Case` before the motion: at its first velocity, or, relaxed and without traction, where the roller stood."""
    if case.speed:
        return replace(case, speed=_first_velocity(motion))
    material, roller = case.material, replace(case.roller, rolling="frictionless")
    return fem_engine.Case(case.layer, roller, Elastic(material.youngs_modulus, material.poisson), 1.0)


def _begun(case, first, task, window, motion, tolerance):
    """The `Instant` before the motion, and the `Pace` of all steps."""
    surface = fem_engine.elastic_surface(replace(case, speed=case.speed or 1.0), task.mesh, window)
    law = creep(case.material)
    contact = fem_engine.at_target(first, fem_engine.surface_of(first, task.mesh, window), task)
    pace = Pace(surface, case, task.terms, law, motion, task.half_width, tolerance)
    places, start = _places(pace), float(motion.position(np.zeros(1))[0])
    w = _displacement(surface, contact)
    retained = steadily_retained(law, surface.x, w, _first_velocity(motion), places - start)
    return Instant(0.0, start, contact, w, places, retained), pace


def _first_velocity(motion):
    return float(motion.velocity(np.zeros(1))[0])


def _places(pace):
    """Places of the layer, close where the roller passes and as far as the mesh reaches, shape (m,)."""
    x, size = pace.surface.x, pace.half_width / PLACES
    way = pace.way(0.0, pace.motion.duration)
    low, high = way.min() - 2 * pace.half_width, way.max() + 2 * pace.half_width
    close = np.linspace(low, high, int(np.ceil((high - low) / size)) + 1)
    ahead, behind = x[x > 2 * pace.half_width] + way.max(), x[x < -2 * pace.half_width] + way.min()
    return np.concatenate([behind, close, ahead])


def _displacement(surface, contact):
    """w at the surface nodes."""
    forces = contact.forces[:, surface.first : surface.last]
    return np.einsum("iakb,kb->ia", surface.response, forces, optimize=True)


def _stepped(pace, before, now, time):
    """The `Instant` at a later time; the one before, or None, tells where the edges go."""
    x, step = pace.surface.x, fading_over(pace.law, pace.way(now.time, time), time - now.time)
    end, interval = step.way[-1], time - now.time
    sought = pace.law.instant * np.eye(len(x))
    known = retained_by(step.shares, now.places, step.faded(now.retained), x + end)
    for place, share, weight in zip(step.way, step.new, step.shares @ step.weights, strict=True):
        N = interpolation(x, within(x, x + end - place))
        sought += weight * share * N
        known += weight * (1 - share) * now.displacement @ N.T
    grip = pace.grip((end - now.position) / interval, interval, known, _shown(pace, now)) if pace.case.sticks else None
    contact = _pressed(pace, sought, known, _ahead(before, now, time), grip)
    w = _displacement(pace.surface, contact)
    retained = step.retained(x, now.places, now.retained, now.displacement, w)
    angle = now.angle + (end - now.position + interval * _ahead_of_way(contact, grip)) / pace.case.roller.radius
    return Instant(time, float(end), contact, w, now.places, retained, float(angle))


def _at_once(pace, now):
    """The `Instant` again with the drag or the torque of the way to come; nothing fades meanwhile."""
    x, law = pace.surface.x, pace.law
    known = retained_by(law.shares, now.places, now.retained, x + now.position)
    grip = pace.grip(0.0, 1.0, known, _shown(pace, now)) if pace.case.sticks else None
    contact = _pressed(pace, law.instant * np.eye(len(x)), known, now.contact, grip)
    angle = now.angle + _ahead_of_way(contact, grip) / pace.case.roller.radius
    return replace(now, contact=contact, displacement=_displacement(pace.surface, contact), angle=angle)


def _shown(pace, now):
    """u at the surface nodes, shape (2, n)."""
    kept = retained_by(pace.law.shares, now.places, now.retained, pace.surface.x + now.position)
    return pace.law.instant * now.displacement + kept


def _ahead_of_way(contact, grip):
    """How much faster along +x the surface of the roller turns than it travels [m/s]."""
    return 0.0 if grip is None else contact.shear.creep * grip.direction


def _pressed(pace, sought, known, start, grip=None):
    """The contact on the surface of which a part is known, from another one on."""
    response = np.einsum("ca,iakb->ickb", sought, pace.surface.response, optimize=True)
    surface = replace(pace.surface, response=response)
    roll = pace.roll.over(surface.x, known)
    # anew where edges jump: the print of the roller nearly fits it where it turns
    for patch, shear in ((start.patch, start.shear), (None, None)):
        try:
            if grip is None:
                return fem_engine.Contact(surface, roll, press(surface, roll, pace.terms, patch))
            return fem_engine.Contact(
                surface, roll, *pressed_and_sheared(surface, roll, pace.terms, grip, patch, shear)
            )
        except BeyondWindowError:
            raise
        except RuntimeError as unsettled:
            reason = unsettled
    raise reason


def _ahead(before, now, time):
    """The contact from which to start, its edges gone on as before."""
    patch = now.contact.patch
    if before is None:
        return now.contact
    share = (time - now.time) / (now.time - before.time)
    trailing, leading = (new + share * (new - old) for new, old in
                         zip(patch.edges, before.contact.patch.edges, strict=True))  # fmt: skip
    return replace(now.contact, patch=replace(patch, trailing=trailing, leading=leading))


def _miss(pace, before, now, later):
    """What the resistance misses for w being taken linear in time, over the tolerance.

    The mean over a step of what a parabola leaves its chord by is dt^2/12 of its second derivative; it leaves the
    tangent of the step before by dt (dt + dt')/2 of that.
    """
    step, earlier = later.time - now.time, 0.0 if before is None else now.time - before.time
    gone = 0.0 if before is None else (now.moment - before.moment) * step / earlier
    miss = np.abs(later.moment - now.moment - gone).sum() * step / (6 * (step + earlier))
    return miss / (pace.tolerance * np.abs(later.moment).sum())


def _marched(pace, start, breaks, stops):
    """All `Instant`s, by steps of the length that the tolerance asks; `stops` holds the breaks too."""
    path, shortest = [start], SHORTEST * pace.quickest
    for begin, end in pairwise(breaks):
        pace = _turned(pace, path, begin, end)
        before, step = None, FIRST * pace.quickest
        while path[-1].time < end:
            now = path[-1]
            time = _end_of_step(pace, now.time, step, stops)
            tried = time - now.time
            try:
                later = _stepped(pace, before, now, time)
                miss = _miss(pace, before, now, later)
            except BeyondWindowError:
                raise
            except RuntimeError:
                if tried < 2 * shortest:
                    raise
                miss = np.inf
            ratio = np.clip(SAFE / np.sqrt(max(miss, SAME)), SHRINKING, GROWING)
            if miss > 1 and tried > shortest:
                step = max(tried * min(ratio, SAFE), shortest)
                continue
            step = max(tried * ratio, step if time in stops else shortest)
            before = now
            path.append(later)
    return path


def _turned(pace, path, begin, end):
    """The `Pace` of a piece of the motion; if drag or torque turn round the path has the instant before it twice."""
    way = float(np.sign(np.diff(pace.motion.position(np.array([begin, end])))[0])) or pace.case.speed
    if way == pace.case.speed:
        return pace
    pace = replace(pace, case=replace(pace.case, speed=way))
    if pace.set_valued:
        path.append(_at_once(pace, path[-1]))
    return pace


def _end_of_step(pace, begin, step, stops):
    """Where a step ends that is about so long, passes no stop and travels `LONGEST` half-widths at most."""
    stop = next(each for each in stops if each > begin + SAME * stops[-1])
    end = min(begin + step, stop)
    while np.abs(np.diff(pace.way(begin, end))).sum() > LONGEST * pace.half_width * (1 + SAME):
        end = begin + (end - begin) * SAFE
    return stop if stop - end < SAME * stops[-1] else end


def _judged(pace, start, breaks, times):
    """The `Instant`s at given times, from the start on; None where the contact is lost."""
    path = [start]
    for begin, end in pairwise(breaks):
        pace, before = _turned(pace, path, begin, end), None
        for time in times:
            if begin < time <= end:
                try:
                    later = _stepped(pace, before, path[-1], time)
                except BeyondWindowError:
                    raise
                except RuntimeError:
                    return None
                before = path[-1]
                path.append(later)
    return path


def _every_second(path, breaks):
    """Times of every second instant of each piece between breaks, and of its end."""
    times = np.unique([each.time for each in path])
    chosen = []
    for begin, end in pairwise(breaks):
        piece = times[(times > begin) & (times <= end)]
        chosen += [*piece[1:-1:2], piece[-1]]
    return chosen


def _rounded(times, breaks):
    """The times [s]; those that miss a break by rounding are there."""
    nearest = [min(breaks, key=lambda each, time=time: abs(each - time)) for time in times]
    near = SAME * breaks[-1]
    return [each if abs(each - time) <= near else float(time) for time, each in zip(times, nearest, strict=True)]


def _travelled(path, judge, case, motion, frames):
    modulus = case.material.youngs_modulus
    forces = modulus * np.array([each.contact.force for each in path])
    edges = np.array([each.contact.patch.edges for each in path])
    time = np.array([each.time for each in path])
    error, steps = None, len(path) - 1
    if judge is not None:
        known = dict(zip(time.tolist(), forces[:, 0], strict=True))
        apart = [abs(modulus * each.contact.force[0] - known[each.time]) for each in judge]
        error = float(max(apart) / max(np.abs(forces[:, 0]).max(), 1e-3 * np.abs(forces[:, 1]).max()))
        steps += len(judge) - 1
    return TransientResult(
        time=time,
        position=np.array([each.position for each in path]),
        velocity=motion.velocity(time),
        load=-forces[:, 1],
        resistance=forces[:, 0],
        leading=edges[:, 1],
        trailing=edges[:, 0],
        error=error,
        steps=steps,
        frames=frames,
        angle=np.array([each.angle for each in path]) if case.sticks else None,
    )


def _refuse(layer, roller, material, motion, mesh, tolerance, time_tolerance, instants):
    fem_engine.require_linear_range(layer, roller, material, 1.0, mesh, tolerance)
    require_positive(time_tolerance=time_tolerance, duration=motion.duration)
    require_finite(instants=instants, position=motion.position(np.linspace(0, motion.duration, 2 * PLACES)))
    outside = [time for time in instants if not 0 <= time <= motion.duration]
    if outside:
        raise ValueError(f"`instants` must lie within the motion, 0 to {motion.duration:g} s, got {outside[0]!r}")
    if roller.indentation is None:
        raise ValueError(f"a motion through time keeps an `indentation`, got `{roller.target[0]}`; give that instead")
    if layer.base == "slip" and roller.friction > 0 and roller.rolling != "frictionless":
        raise ValueError(
            f"over a slipping layer, which nothing holds along x where the motion turns, a roller is known in time "
            f"without friction only, got `rolling` '{roller.rolling}' with `friction` {roller.friction!r}"
        )
    if layer.base == "slip" and roller.profile == "deformed":
        raise ValueError("over a slipping layer the gap must be vertical, got `profile` 'deformed'; use 'circle'")
