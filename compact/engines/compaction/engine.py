"""The engine "compaction": a rigid roller that presses a layer of mix for good, in plane strain and finite strain.

On a coarse mesh the steady balance of a layer so soft that it hardly yields is found from rest and stiffened to the one
asked for (`stiffening`); that starts the finer mesh, where the balance is solved at once (`steady`) if it is near
enough. Where either does not converge the roller marches on (`march`) until the tails of load, resistance and exit
density say that it is steady. A prescribed load, peak pressure or exit density is met by moving the roller up or down.
A neighbour (another depth, speed or parameter) starts from the last solution, its mesh stretched as the contact is.

Envelope: frictionless, sliding, free and driven rollers, bonded and slipping bases; `march.at_once` of the result tells
which way ended it. A march has an error of its steps: on coarse meshes it resists by 4 to 6 % less, on 12 increments it
bears 1 to 2 % more than on 24. Solved at once: 2 mm in a layer of 0.1 m, capture angle 11 degrees, free with friction
0.3, in 31 s of processor time on 12 increments. Lifts of 0.04 to 0.08 m of the prior's mix all get steady, most by a
march, in some 50 s. Over a layer that is high beside the contact mix may heap up without end: then it raises.
Mix is refused that would have to leave with k >= 1. A depth for which loose mix has no voids by the estimate of
`heaping` is refused before anything is solved, and a march whose bow wave grows too high ends with the same error.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from compact.engines.compaction.heaping import STEEPEST, Heaping, HeapingError, remedies, require_no_heaping
from compact.engines.compaction.incremental_rolling import DRAG, March, tail
from compact.engines.compaction.results import CompactionContactResult, build_result
from compact.engines.compaction.roller_frame import Frame, rolling_mesh, transferred
from compact.engines.compaction.steady_newton_krylov import Steady, stiffened
from compact.material.laws import Compaction
from compact.mesh import RowMesh
from compact.numerics.validation import require_between, require_finite, require_known, require_positive
from compact.rolling_contact import HEIGHT_TOLERANCE, require_on_target, require_torque_allowed

__all__ = ["CompactionContactResult", "HeapingError", "roll"]

INCREMENTS = 12  # per contact length sqrt(2 R depth) of the fed mix
COARSE = 4  # of the first march
STEADY = 5e-3  # of load, resistance and exit density, what their tails have still to go
RESISTED = 1e-2  # of the load, below which a resistance, as of a second pass, counts as that much
ROUGHLY = 2e-2  # the same on the coarse mesh and on the way to a target
TARGET = 1e-3  # of a prescribed load, peak pressure or exit density
DENSITY = 1e-4  # of a density ratio that a march must meet, whose columns of points scatter as much
LONGEST = 12.0  # layer heights or contact lengths of travel after which a march that is not steady gives up
TARGETS = 12  # changes of depth
NOTHING = 1e-3  # [-], of a target, below which a load or pressure counts as that much
SPREAD = 1.5  # contact lengths in front, down to which the first guess of a depth sees its strain
LARGEST_CHANGE = 1.4  # of the depth at once
NEARLY_FULL = 0.98  # of the depth at which the mix would leave full, the deepest that is tried
SETTLING = 0.25  # of the drag, once the roller has come to its height
UNBALANCED = 1e-2  # of the forces, what drag may still hold when the roller is called steady
HIGH = 0.5  # [-], of the highest bow wave, from which a march stops by what its wave tends to
HIGHER = 2.0  # [-], of the highest bow wave, what it must tend to then
PARTS = (1, 2)  # of the way to a neighbour
SHARE = 0.03  # of the elastic stiffness, at first on that way; with .01 and .1 it is not found 5 % deeper
STEPPED = 0.25  # over the increments, the error of a march at least: six lifts bear 0.8 to 1.9 % less on 24 than on 12
ERROR_SHARE = 0.5  # of the larger change from the coarser mesh: from 6 increments 1.3 %, and 0.5 % is left at 12


def roll(
    layer,
    roller,
    material,
    speed,
    *,
    torque=None,
    strain="finite",
    fed=None,
    start=None,
    exit_density_ratio=None,
    increments=INCREMENTS,
    steady=STEADY,
    steepest: float | None = STEEPEST,
    progress: Callable[[str], None] | None = None,
):
    """One roller in steady motion over a layer of compacting mix, a `CompactionContactResult`.

    Parameters
    ----------
    layer : Layer; its height is that of the mix as it is fed
    roller : Roller, every profile; "circle" and "parabola" press vertically; "sliding" with the traction f p on the mix
        along the travel all over the contact, "free" or "driven", which stick and slip
    material : Compaction
    speed : along x [m/s], not 0; enters by `material.rate_factor` and its sign
    torque : on a roller that is free or driven, per unit length, + turning it the way it travels [N]; without it a
        free roller has none
    strain : "finite", or "small" (fair up to capture angles of 12-15 degrees, reports k low by half a squared strain)
    fed : `Fed` of an earlier pass, its `exit`; without it mix free of stress at `material.fed_density_ratio`
    start : CompactionContactResult of a neighbour with the same layer and feed, from whose state the roller rolls on, and
        whose mesh and error are this one's too
    exit_density_ratio : mean wanted of the mix that leaves, met by a march to 1e-4; the indentation of the roller is
        then a first guess
    increments : of travel per contact length, and elements
    steady : relative change of load, resistance and exit density that may be left
    steepest : contact angle [rad], up to pi/2, beyond which a bow wave counts as one that grows without end. The
        estimate of `heaping` refuses depths and loads in fresh mix that would need more, and a march stops there. None
        does neither.
    progress : called with a line of text after each iteration of the direct solution and each step of a march

    Raises HeapingError, a RuntimeError, where the mix has no voids for the depth by that estimate, or where the bow
    wave of a march grows beyond `steepest`; RuntimeError with the step reached where no balance is found or the roller
    does not get steady.
    """
    require_compactable(layer, roller, material, speed, strain, exit_density_ratio, fed)
    require_torque_allowed(roller, torque)
    require_positive(increments=increments, steady=steady)
    if steepest is not None:
        require_positive(steepest=steepest)
        require_between(0.0, np.pi / 2, steepest=steepest)
    target = _Target(layer, roller, material, exit_density_ratio, fed)
    heaping = _heaping(layer, roller, material, speed, strain, steepest)
    if heaping is not None and fed is None:
        require_no_heaping(heaping, *target.prescribed)
    watch = {"highest": np.inf if heaping is None else heaping.highest, "progress": progress}
    with threadpool_limits(1):
        if start is not None:
            depth = roller.indentation if target.quantity is None else start.indentation
            march = _neighbour(start, layer, roller, torque, material, speed, fed, depth, watch)
            rolled = build_result(target.reached(march, steady), layer, roller, material, speed)
            target.require_target_reached(rolled, torque)
            return replace(rolled, error=start.error and tuple(max(error, _stepped(rolled)) for error in start.error))
        depth, coarse, march = target.first_depth(), None, None
        counts = [increments] if increments <= COARSE else [COARSE, increments]
        for count in counts:
            coarse = march
            frame = _frame(layer, roller, material, speed, strain, fed, depth, count)
            march = _march(frame, roller, torque, watch, coarse)
            softly = _soft_start(layer, roller, torque, material, watch) if coarse is None else None
            rough = count < increments and target.quantity is not None
            try:
                march = target.reached(march, max(steady, ROUGHLY) if rough else steady, depth, softly)
            except RuntimeError as error:
                raise type(error)(f"{error}{_advice(heaping, target, fed)}") from error
            depth = layer.height - march.steps[-1].lowest
        rolled = build_result(march, layer, roller, material, speed)
        target.require_target_reached(rolled, torque)
        return _with_error(rolled, coarse)


def _heaping(layer, roller, material, speed, strain, steepest):
    """The `Heaping` of a scene; None where the estimate does not apply.

    In small strain no wave rises, and mix on a base that slips may leave longer instead of denser.
    """
    if steepest is None or strain == "small" or layer.base == "slip":
        return None
    return Heaping(layer.height, roller.radius, material, steepest, material.rate_factor(speed))


def _advice(heaping, target, fed):
    """Clause with remedies for a depth in fresh mix at which the roller does not get steady; "" for anything else."""
    name, _, depth = target.prescribed
    if heaping is None or depth is None or fed is not None:
        return ""
    return f"; {remedies(heaping, depth, for_density=name == 'exit_density_ratio')}"


def _frame(layer, roller, material, speed, strain, fed, depth, count):
    length = np.sqrt(2 * roller.radius * depth)
    mesh = rolling_mesh(layer.height, length, length / count)
    rate = material.rate_factor(speed)
    return Frame(mesh, material, layer.base, length, fed=fed, finite=strain == "finite", rate_factor=rate)


def _march(frame, roller, torque, watch=None, coarse=None):
    turns = roller.rolling in ("free", "driven") and roller.friction > 0
    friction = 0.0 if roller.rolling == "frictionless" else roller.friction
    torque = (torque or 0.0) if turns else None
    march = March(frame, roller.radius, profile=roller.profile, friction=friction, torque=torque, **(watch or {}))
    if coarse is not None:
        march.take_over(coarse, transferred(coarse.condition, coarse.frame, frame))
    return march


def _soft_start(layer, roller, torque, material, watch):
    """What finds the steady march on a frame with the lowest generatrix at a height, by stiffening soft mix."""

    def softly(frame, lowest):
        def march_of(share):
            softer = replace(material, unloading_modulus=share * material.unloading_modulus)
            finite, rate = frame.solid.finite, frame.solid.rate_factor
            on = Frame(frame.mesh, softer, layer.base, frame.length, fed=frame.given, finite=finite, rate_factor=rate)
            return _march(on, roller, torque, watch)

        return stiffened(march_of, lowest)

    return softly


def _neighbour(start, layer, roller, torque, material, speed, fed, depth, watch):
    """The march of a neighbour at a depth: where its start was solved at once so is it, in as few parts of the change
    of depth as do; else near its start."""
    old = start.march
    if layer != start.layer or fed is not old.frame.given:
        raise ValueError("`start` must have rolled over the same `layer` and the same `fed` mix")
    for parts in PARTS if old.at_once else ():
        march = old
        for there in np.geomspace(start.indentation, depth, parts + 1)[1:]:
            march = _stretched(march, layer, roller, torque, material, speed, there, watch)
            if not _at_once(march, layer.height - there):
                break
        else:
            return march
    march = _stretched(old, layer, roller, torque, material, speed, depth, watch)
    march.sought = layer.height - depth
    return march


def _stretched(old, layer, roller, torque, material, speed, depth, watch):
    """The march of another roller, on the mesh and with the motion of the old one stretched as its contact is."""
    stretch = float(np.sqrt(depth / (layer.height - old.steps[-1].lowest)))
    mesh = RowMesh(stretch * old.frame.mesh.x, old.frame.mesh.y)
    finite, rate, fed = old.frame.solid.finite, material.rate_factor(speed), old.frame.given
    frame = Frame(mesh, material, layer.base, stretch * old.frame.length, fed=fed, finite=finite, rate_factor=rate)
    march = _march(frame, roller, torque, watch)
    march.take_over(old, replace(old.condition, displacement=stretch * old.condition.displacement))
    march.face = march.face.carrying(old.push.pressure, old.push.shear, old.push.creep)
    return march


class _Target:
    """What is prescribed, and the depth that meets it."""

    def __init__(self, layer, roller, material, exit_density_ratio, fed):
        self.height, self.roller, self.law = layer.height, roller, material
        self.fed_mean = _fed_mean(material, fed)
        self.deepest = NEARLY_FULL * layer.height * (1 - self.fed_mean)
        self.densest = self.fed_mean if fed is None else float(fed.state.density_ratio.max())
        self.quantity, self.value = None, None
        if exit_density_ratio is not None:
            self.quantity, self.value = "exit_density_ratio", exit_density_ratio
        elif roller.indentation is None:
            self.quantity = "load" if roller.load is not None else "peak_pressure"
            self.value = getattr(roller, self.quantity)

    @property
    def prescribed(self):
        """Name and value of what is prescribed, and the depth [m] that it requires, None for a load or a pressure."""
        if self.quantity is None:
            return "indentation", self.roller.indentation, self.roller.indentation
        if self.quantity == "exit_density_ratio":
            return self.quantity, self.value, self.height * (1 - self.fed_mean / self.value)
        return self.quantity, self.value, None

    def first_depth(self):
        """The indentation, or one that is about right."""
        if self.roller.indentation is not None:
            return self.roller.indentation
        deepest = min(0.2 * self.height, 0.9 * self.deepest, 0.9 * self.roller.radius)
        depths = np.geomspace(min(1e-5 * self.height, 1e-3 * deepest), deepest, 100)
        length = np.sqrt(2 * self.roller.radius * depths)
        strain = depths / np.minimum(self.height, SPREAD * length)
        peak = 1.15 * self.law.yield_pressure(self.densest / (1 - strain))
        if self.quantity == "peak_pressure":
            return float(np.interp(self.value, peak, depths))
        # a Hertzian pressure on the front of the contact: 2/3 of its peak over the length; pressed mix gives way less
        elastic = self.law.unloading_modulus / (1 - self.law.poisson**2) / 4
        return float(np.interp(self.value, np.minimum(0.7 * peak * length, elastic * depths), depths))

    def reached(self, march, steady, depth=None, softly=None):
        """The march rolled on until it is steady with the target met, or another one on its frame."""
        depth = self._asked(march, depth)
        if self.quantity is None:
            return _steady_at(march, self.height - depth, steady, softly)
        logs, misses = [], []
        unit = {"load": " N/m", "peak_pressure": " Pa"}.get(self.quantity, "")
        for _ in range(TARGETS):
            rough, left = not misses or abs(misses[-1]) > 10 * TARGET, steady
            if self.quantity != "exit_density_ratio":
                left = max(steady, ROUGHLY) if rough else min(steady, TARGET / 2)
            march = _steady_at(march, self.height - depth, left, softly)
            logs.append(np.log(depth))
            misses.append(self._miss(march))
            if self._met(march, misses[-1], rough):
                return march
            slope = self._slope(logs, misses)
            if depth == self.deepest and misses[-1] < 0:
                break
            change = float(np.clip(np.exp(-misses[-1] / slope), 1 / LARGEST_CHANGE, LARGEST_CHANGE))
            depth = min(depth * change, self.deepest)
        nearest = int(np.argmin(np.abs(misses)))
        beyond = f" down to {1e3 * self.deepest:.4g} mm, where the mix is nearly full" if depth == self.deepest else ""
        raise RuntimeError(
            f"`{self.quantity}` {self.value:g}{unit} not met{beyond} after {len(logs)} depths from "
            f"{1e3 * np.exp(min(logs)):.4g} to {1e3 * np.exp(max(logs)):.4g} mm; the nearest was "
            f"{self._found(misses[nearest]):.5g}{unit} at {1e3 * np.exp(logs[nearest]):.4g} mm"
        )

    def require_target_reached(self, rolled, torque):
        """Raise RuntimeError unless the contact has what is prescribed, and the torque on a roller that turns.

        Small strain knows the density ratio to half a squared strain.
        """
        push, face, turned = rolled.march.push, rolled.march.face, None
        if push.creep is not None:
            turned = torque or 0.0, float(-face.radius * (face.weight @ push.shear))
        density = self.value if self.quantity == "exit_density_ratio" else None
        linear = density is not None and not rolled.march.frame.solid.finite
        tolerance = TARGET + (0.5 * (1 - self.fed_mean / density) ** 2 if linear else 0.0)
        require_on_target(rolled, self.roller, tolerance, exit_density_ratio=density, torque=turned)

    def _found(self, miss):
        """Value of what is prescribed that a miss belongs to."""
        if self.quantity == "exit_density_ratio":
            return self.fed_mean + np.exp(miss) * (self.value - self.fed_mean)
        return self.value * np.exp(miss)

    def _asked(self, march, depth):
        if self.quantity is None:
            return self.roller.indentation
        return depth if depth is not None else self.height - march.steps[-1].lowest

    def _miss(self, march):
        limit, left = march.limit(self.quantity)
        last = getattr(march.steps[-1], self.quantity)
        limit = limit if left > TARGET * last else last
        if self.quantity == "exit_density_ratio":  # above what is fed, which depth makes in proportion
            return float(np.log(max(limit - self.fed_mean, 1e-6) / (self.value - self.fed_mean)))
        return float(np.log(max(limit / self.value, NOTHING)))  # a tail may tend below none

    def _met(self, march, miss, rough):
        if self.quantity == "exit_density_ratio" and not march.at_once:
            return abs(np.expm1(miss)) * (self.value - self.fed_mean) < DENSITY
        return abs(miss) < TARGET and not rough

    def _slope(self, logs, misses):
        if len(logs) == 1 or logs[-1] == logs[-2]:
            return 1.0
        low, high = (0.8, 1.25) if self.quantity == "exit_density_ratio" else (0.3, 3.0)
        return float(np.clip((misses[-1] - misses[-2]) / (logs[-1] - logs[-2]), low, high))


def _steady_at(march, lowest, steady, softly=None):
    """The march steady at a height: solved at once from a neighbour, `softly` where nothing was marched yet, or from
    roughly there; or else marched to."""
    if march.at_once and _at_once(march, lowest):
        return march
    if softly and (march.at_once or not march.steps):
        try:
            return softly(march.frame, lowest)
        except RuntimeError:  # the way through soft mix ends
            pass
    _until_steady(march, lowest, max(steady, ROUGHLY))
    if not _at_once(march, lowest) and steady < ROUGHLY:
        _until_steady(march, lowest, steady)
    return march


def _at_once(march, lowest):
    """Whether the steady balance is found at once from where the march is, which goes on there; not sought twice."""
    if march.sought == lowest:
        return False
    frame, displacement = march.frame, march.condition.displacement
    try:
        steady = Steady(frame, march.face.at(lowest), progress=march.progress)
        if march.at_once:
            balance = steady.balanced(displacement, SHARE)
        else:
            balance = steady.balanced(frame.flat_behind(displacement))
        march.settled(balance, lowest)
    except RuntimeError:  # not balanced, or the layer folds over
        march.sought = lowest
        return False
    return True


def _until_steady(march, lowest, steady):
    """March on, first to the height, until the tails have no more than `steady` to go; the last step without drag."""
    stayed, way_out = _stayed(march, lowest), int(march.frame.way_out / march.frame.step)
    way = [] if stayed else _way_down(march, lowest)
    arrives = len(march.steps) + len(way) - stayed
    reach, calm = LONGEST * max(march.frame.mesh.height, march.frame.length), 0
    for k in range(int(reach / march.frame.step)):
        there = len(march.steps) + 1 - arrives
        drag = DRAG if there <= march.window else SETTLING * DRAG
        step = march.advance(way[k] if k < len(way) else lowest, drag)
        if k >= len(way):
            _refuse_high_wave(march, arrives)
        settled = there >= way_out + 3 * march.window and step.residual < UNBALANCED
        calm = calm + 1 if settled and _left(march, arrives) < steady else 0
        if calm > march.window:  # a tail that turns round is still for a moment only
            march.advance(lowest, drag=0.0)
            return march
    raise RuntimeError(
        f"not steady at depth {1e3 * (march.frame.mesh.height - lowest):.4g} mm after {march.steps[-1].travel:.3g} m "
        f"of travel and {len(march.steps)} steps: {_percent(_left(march, arrives))} of load, resistance or exit "
        f"density left to go, {_percent(step.residual)} of the forces held by drag; {_state(step)}"
    )


def _percent(share):
    return f"{100 * share:.2g} %" if share < 10 else "far more than all"


def _state(step):
    return f"load {step.load:.0f} N/m, resistance {step.resistance:.0f} N/m, bow wave {1e3 * step.wave:.3g} mm high"


def _refuse_high_wave(march, arrives):
    """Stop a march whose bow wave is as high as the roller may be steep, or will be."""
    step, depth = march.steps[-1], march.frame.mesh.height - march.steps[-1].lowest
    room = march.highest - depth
    limit, left = tail([s.wave for s in march.steps[arrives:]], march.window)
    if step.wave < room and not (step.wave > HIGH * room and HIGHER * room < limit and left < np.inf):
        return
    way = "has grown to" if step.wave >= room else f"tends to {1e3 * limit:.3g} mm, beyond"
    raise HeapingError(
        f"the mix heaps up in front of the roller at depth {1e3 * depth:.4g} mm: after {step.travel:.3g} m of travel "
        f"the bow wave {way} the {1e3 * room:.3g} mm at which the contact is too steep to press the mix down; "
        f"{_state(step)}"
    )


def _stayed(march, lowest):
    """Steps of the march at this height so far, but for the one that it took over."""
    heights = np.array([step.lowest for step in march.steps[1:]])
    return int(np.argmax(np.append(heights[::-1] != lowest, True)))


def _way_down(march, lowest):
    """Heights of the lowest generatrix, step by step, until it is where it stays."""
    start = march.steps[-1].lowest if march.steps else march.frame.mesh.height
    return np.linspace(start, lowest, march.window * (1 if march.steps else 2) + 1)[1:]


def _left(march, arrives):
    """What the tails of load, resistance and exit density have still to go, relative, since the roller is there."""
    last = march.steps[-1]
    steps = march.steps[arrives:] or [last]
    counted = max(abs(last.resistance), RESISTED * last.load)
    scale = {"load": last.load, "resistance": counted, "exit_density_ratio": 1.0}
    return max(tail([getattr(s, name) for s in steps], march.window)[1] / scale[name] for name in scale)


def _with_error(rolled, coarse):
    """The result with the share of its change from the coarser mesh that is told as its error."""
    if coarse is None:
        return rolled
    load, resistance = (coarse.limit(name)[0] for name in ("load", "resistance"))
    scale = max(abs(rolled.resistance), 1e-3 * rolled.load)
    changes = abs(rolled.load - load) / rolled.load, abs(abs(rolled.resistance) - resistance) / scale
    return replace(rolled, error=(max(ERROR_SHARE * max(changes), _stepped(rolled)),) * 2)


def _stepped(rolled):
    """The least error that is told of a march, where two meshes may agree by chance; none of a balance at once."""
    frame = rolled.march.frame
    return 0.0 if rolled.march.at_once else float(STEPPED * frame.step / frame.length)


def _fed_mean(material, fed):
    return material.fed_density_ratio if fed is None else fed.density_ratio


def require_compactable(layer, roller, material, speed, strain, exit_density_ratio, fed):
    require_finite(speed=speed)
    if speed == 0:
        raise ValueError("`speed` must not be 0, got 0: the resistance is set-valued there; say which way it goes")
    if not isinstance(material, Compaction):
        raise ValueError(f"`material` must be Compaction, got {type(material).__name__}")
    if layer.plies:
        raise ValueError(f"`plies` are for linear layers; a compacting one takes `fed`, got {len(layer.plies)} plies")
    require_known("strain", strain, ("finite", "small"))
    require_known("rolling", roller.rolling, ("frictionless", "sliding", "free", "driven"))
    require_known("profile", roller.profile, ("parabola", "circle", "deformed"))
    if fed is not None and abs(fed.height / layer.height - 1) > HEIGHT_TOLERANCE:
        raise ValueError(f"`layer` must be as high as `fed`, {fed.height!r} m, got {layer.height!r}")
    mean = _fed_mean(material, fed)
    if exit_density_ratio is not None and not mean < exit_density_ratio < 1:
        raise ValueError(
            f"`exit_density_ratio` must lie between that of the fed mix {mean:.6g} and 1, got {exit_density_ratio!r}"
        )
    depth = roller.indentation
    if depth is not None and roller.profile != "parabola" and depth >= roller.radius:
        raise ValueError(
            f"`indentation` must be less than the roller's `radius` {roller.radius!r} m, or its axle would be below "
            f"the mix in front, got {depth!r}"
        )
    if depth is not None and depth >= layer.height * (1 - mean):
        raise ValueError(
            f"`indentation` {depth!r} m would press mix fed at {mean:.6g} and {layer.height!r} m beyond full density; "
            f"it must be less than {layer.height * (1 - mean):.6g} m"
        )
