"""Search for the steady state of a roller on one mesh, for a prescribed depth, load, peak pressure or density.

A cycle rolls on by a contact length and measures the drift of the bow wave over the second half of the travel since the
last change. The drift gives the distance to the steady state (`steady_state`). Wave and depth are then corrected
together: the wave by a jump along its slow mode, the depth by a secant method for the extrapolated steady state. Where
the drift does not stand out from its scatter, as in mix with a shear line whose bands form and pass under the roller,
it just rolls on, so that the travel that is measured grows and the scatter of the drift falls. The search ends when the
distance is below the tolerance and the target is satisfied. The residual of a step is a fixed share of the distance. A
smaller tolerance thus means more travel and smaller residuals.

A motion that is not steady at the largest travel has one of two answers. If the wave takes up mix without slowing
down, the mix heaps up in front of the roller (`HeapingError`). The measure is mass: the inflow of fed mix less the
outflow at the exit column. Jumps disturb it, so that at the end of a search a wave that takes up mix is also without
end if its area grows as fast as ever. Otherwise the search has not decided, and its error has the last load,
resistance and distance (`UnsteadyError`).
"""

from copy import copy
from dataclasses import replace

import numpy as np

from compact.engines.compaction.roller_frame import transfer_state
from compact.engines.compaction.rolling import DAMPING, FINAL_DAMPING_RATIO, ROLLING_TOLERANCE, IncrementalRolling
from compact.engines.compaction.rolling_case import DepthSecant, DepthTarget
from compact.engines.compaction.steady_state import QUANTITIES, BowWaveMode, ErrorParts, Relaxation, WaveDrift
from compact.rolling_contact import EquilibriumError, Heaping, HeapingError, Unsteady, UnsteadyError, resistance_scale

# chosen by halving and doubling each on random lifts, see docs/theory/compaction.md; lengths over the contact length
SETTLING, CYCLE = 2.0, 1.0  # [-], travel after a change and in a cycle
FIRST_LENGTH = 8.0  # [-], relaxation length of the wave before any is known
LENGTH_ERROR = 0.5  # [-], relative error of the relaxation length, which jumps then leave; largest jump over the wave
MIN_CHANGE = 0.02  # [-], least change of the wave between two settled states that define a mode, over the wave
MIN_WAVE = 0.1  # [-], least area of a wave over depth and contact length whose mode counts; lower ones are scatter
SIGNIFICANCE = 3.0  # [-], standard errors from which a drift of the wave counts
RESIDUAL_SHARE, MAX_RESIDUAL = 0.1, 5e-3  # [-], residual of a step over the distance to the steady state, and at most
NEAR = 4.0  # [-], distance over its tolerance from which the depth is corrected, since both at once oscillate
MAX_DISTANCE, PATIENCE = 0.1, 4  # [-], distance that is accepted, and told, at the largest travel; its power over it
MAX_TRAVEL = 30.0  # [-], on the mesh of the result
SLOWING, GROWN = 0.8, 4.0  # [-], growth over the fastest one of a wave grown by the other factor that has no end

APPROACH, FIRST_APPROACH = CYCLE / 2, SETTLING + CYCLE  # [-], travel in which a depth is reached; from rest
FINAL_TRAVEL = SETTLING + CYCLE / 2  # [-], after the last jump; the mix of the exit column has passed it all
MIN_WAVES = 3  # [-], cycles with two changes, before a wave may count as endless
MIN_STEPS = 4  # [-], of a measurement
MAX_MISS = 10.0  # [-], of the tolerance of a target, which is accepted, and told, at the largest travel
HEIGHT_SHARE = 1 / 3  # [-], of the layer height, which counts as contact length at least; later passes are that short
JUMP_TRIALS = (1.0, 0.4, 0.0)  # [-], shares of a jump that are tried in turn if a later step has no equilibrium
EXACT_STEPS = 4  # [-], last steps; the gap in the contact is then below 1e-5 of the depth
SAME_DEPTH = 1e-3  # [-], relative change of the depth below which settled states belong to one depth
STRETCHED_DEPTH = 1.25  # [-], ratio of a depth to that of the mesh from which the mesh is stretched
DEPTH_EXPONENTS = np.array([1.2, 2.3])  # [-], of load and resistance over the depth
WAVE_EXPONENT = 3.4  # [-], of the area of the wave over the depth, roughly
MIN_RESISTANCE = 3e-2  # [-], least scale of the resistance over the load; that of a driven roller may vanish


class SteadySearch:
    """Search for the steady state on one mesh.

    Parameters
    ----------
    target : DepthTarget
        Prescribed quantity of a case, which stretches the mesh to other depths.
    rolling : IncrementalRolling
        Roller at rest or in any state; replaced where the mesh is stretched.
    depth : float
        First depth [m].
    coarse : SteadySearch, optional
        Search on the mesh before, from whose state this one starts.

    Attributes
    ----------
    relaxation : Relaxation
        Slow relaxation of the bow wave.
    known_factor : float
        Load in the limit of short increments over that of this search, where none before determines it [-].
    values : ndarray, shape (4,)
        `QUANTITIES` in the steady state.
    drift, start : ndarray, shape (4,)
        Distances from it: along the slow mode, and scatter with the transient that is not part of the mode.
    first : ndarray, shape (3, 4)
        `values`, `drift` and `start` at the first depth, which is that of the search before: what differs from its
        values is an effect of the mesh.
    distance : float
        Their largest sum, of load and resistance over their own, the latter not too small, and of the density [-].
    is_steady : bool
        True if the motion is steady.
    """

    def __init__(
        self, target: DepthTarget, rolling: IncrementalRolling, depth: float, coarse: "SteadySearch | None" = None
    ) -> None:
        self.case, self.target, self.rolling, self.depth, self.coarse = target.case, target, rolling, depth, coarse
        self.relaxation, self.known_factor = Relaxation(), 1.0
        self.tolerance = self.case.numerics.steady_tolerance
        self.target_tolerance = target.tolerance(self.elements, len(rolling.parts))
        self.values = self.drift = self.start = np.zeros(len(QUANTITIES))
        self.first, self._first_depth = np.zeros((3, len(QUANTITIES))), depth
        self.distance, self.is_steady = np.inf, False
        self._miss, self._missed, self._begin = 0.0, "", 0
        self._depth_exponent: float | None = None
        self._settled: tuple[IncrementalRolling, WaveDrift] | None = None
        self._waves: tuple[WaveDrift, ...] = ()
        if coarse is not None:
            self.rolling, self.relaxation = coarse.rolling, coarse.relaxation
            self._depth_exponent = coarse._depth_exponent
            self._continue_on(rolling)

    @property
    def elements(self) -> float:
        """Elements per contact length [-]."""
        return self.rolling.frame.contact_length / self.rolling.frame.step

    @property
    def increments(self) -> float:
        """Increments per contact length [-]."""
        return self.elements * len(self.rolling.parts)

    @property
    def load_factor(self) -> float:
        """Load in the limit of short increments over that of this search [-], by the one before on an equal mesh."""
        coarse, change = self.coarse, self._change_by_mesh
        if coarse is None or round(coarse.elements) != round(self.elements) or abs(change) > MAX_DISTANCE:
            return self.known_factor
        return 1 + change / (self.increments / coarse.increments - 1)

    @property
    def _change_by_mesh(self) -> float:
        """Relative change of the load from the steady state on the mesh before [-], 0 without one."""
        coarse, load = self.coarse, float(self.first[0, 0])
        return 0.0 if coarse is None or not coarse.is_steady or not load else 1 - float(coarse.values[0]) / load

    def _continue_on(self, new: IncrementalRolling) -> None:
        """Continue from the present state on another mesh."""
        old, mode = self.rolling, self.relaxation.mode
        new.initialise_from(old, transfer_state(old.state, old.frame, new.frame))
        self.rolling = new
        self.relaxation = replace(self.relaxation, mode=None if mode is None else mode.on_mesh(old, new))

    def run(self) -> None:
        """Roll until the motion is steady and the target satisfied, or to the largest travel.

        Raises
        ------
        HeapingError
            If the wave takes up mix without slowing down.
        EquilibriumError
            If the first steps have no equilibrium.
        """
        try:
            self._search()
        except EquilibriumError as error:
            if self._is_endless():
                raise self._heaping_error("grows without slowing down until a step fails") from error
            if not self._waves and self.coarse is None:
                raise

    def _search(self) -> None:
        """Measure the drift and correct wave and depth in cycles."""
        secant, first = DepthSecant(self.target, self._depth_exponent), len(self.rolling.steps)
        self.rolling.solver.tolerance = MAX_RESIDUAL
        self._settle(DAMPING)
        travelled = 0.0
        while travelled < MAX_TRAVEL:
            drift = self._measure()
            jump = self._estimate(drift)
            self._require_slowing()
            travelled = (len(self.rolling.steps) - first) * self.rolling.frame.step / self._length
            accepted = max(self.tolerance, MAX_DISTANCE * (travelled / MAX_TRAVEL) ** PATIENCE)
            depth, is_met = self.depth, False
            if secant.is_measured:  # at a depth that a measured value has corrected
                is_met = True
            elif self.distance < NEAR * accepted:
                corrected = secant.next_depth(depth, self._target_value(), self._target_factor)
                self._depth_exponent, is_met = secant.slope, abs(secant.last_miss) < self.target_tolerance
                depth = depth if is_met else corrected
            if is_met and self.distance < accepted:
                value = self._finish(jump)
                depth, jump = secant.next_depth(self.depth, value, self._target_factor, measured=True), 0.0
                self._miss = secant.last_miss
                if abs(self._miss) < self.target_tolerance:
                    self.is_steady = True
                    return
            self.rolling.solver.tolerance = min(RESIDUAL_SHARE * max(self.distance, self.tolerance), MAX_RESIDUAL)
            if jump or depth != self.depth:
                self._correct(depth, jump)
        self._miss = secant.last_miss
        self._missed = secant.failure() if abs(self._miss) > MAX_MISS * self.target_tolerance else ""
        self.is_steady = self.distance < MAX_DISTANCE
        if not self.is_steady and self._is_endless():
            raise self._heaping_error("still grows, without slowing down")
        self._advance_exactly()

    def _settle(self, damping: float = FINAL_DAMPING_RATIO * DAMPING) -> None:
        """Roll to the present depth and on; the drift is measured from there."""
        rolling, count = self.rolling, 0
        start = rolling.steps[-1].bottom_height if rolling.steps else rolling.frame.mesh.height
        if start != self._height:
            count = self._steps_of(APPROACH if rolling.steps else FIRST_APPROACH)
        for height in np.linspace(start, self._height, count + 1)[1:]:
            rolling.advance(float(height), damping)
        self._begin = max(len(rolling.steps) - 1, 0)
        self._roll(SETTLING, damping)

    def _roll(self, share: float, damping: float = FINAL_DAMPING_RATIO * DAMPING) -> None:
        """Roll a share of the contact length at the present depth."""
        for _ in range(self._steps_of(share)):
            self.rolling.advance(self._height, damping)

    def _measure(self) -> WaveDrift:
        """Roll on, and fit the drift in the second half of the travel since the last change."""
        begin = copy(self.rolling)
        self._roll(CYCLE)
        steps = self.rolling.steps[self._begin :]
        drift = WaveDrift.of_steps(steps[len(steps) // 2 :])
        self._waves += (drift,)
        self._update_relaxation(begin, drift)
        return drift

    def _update_relaxation(self, begin: IncrementalRolling, drift: WaveDrift) -> None:
        """Fit relaxation length and mode to two settled states of one depth, where they differ beyond their scatter."""
        if self._is_low(drift):
            return
        first, before = (begin, None) if self._settled is None else self._settled
        change, length, mode = drift.wave_area - first.steps[-1].wave_area, self.relaxation.length, self.relaxation.mode
        is_wide = abs(change) >= max(MIN_CHANGE * drift.wave_area, SIGNIFICANCE * drift.wave_error * drift.travel)
        if before is not None and (is_wide or length is None):
            bend = before.wave_slope - drift.wave_slope
            if change * bend > 0 and abs(bend) > SIGNIFICANCE * np.hypot(before.wave_error, drift.wave_error):
                length = float(min(change / bend, MAX_TRAVEL * self.rolling.frame.contact_length))
        if is_wide and (before is not None or mode is None):
            slopes = drift.slopes / drift.wave_slope if before is None else (drift.values - before.values) / change
            mode = BowWaveMode.between(first, self.rolling, slopes)
        self.relaxation, self._settled = Relaxation(length, mode), (copy(self.rolling), drift)

    def _is_low(self, drift: WaveDrift) -> bool:
        """Return whether a wave is too low to count."""
        return drift.wave_area < MIN_WAVE * self.depth * self.rolling.frame.contact_length

    def _estimate(self, drift: WaveDrift) -> float:
        """Estimate steady values and errors; return the distance of the area of the wave to its steady value [m2]."""
        known, contact_length = self.relaxation, self.rolling.frame.contact_length
        length = FIRST_LENGTH * contact_length if known.length is None else known.length
        slopes = np.zeros(len(QUANTITIES)) if known.mode is None else known.mode.slopes
        jump, scatter = length * drift.wave_slope, length * drift.wave_error
        if known.mode is None or abs(drift.wave_slope) < SIGNIFICANCE * drift.wave_error:
            jump = 0.0
        self.values = drift.values + slopes * jump
        transient = self._length * np.abs(drift.slopes - slopes * drift.wave_slope)
        self.drift, self.start = LENGTH_ERROR * np.abs(slopes * jump), np.abs(slopes) * scatter + transient
        if self.depth == self._first_depth:
            self.first = np.array([self.values, self.drift, self.start])
        load, resistance = np.abs(drift.values[:2])
        scales = [load, max(resistance, MIN_RESISTANCE * load), 1.0]
        self.distance = float(((self.drift + self.start)[:3] / scales).max())
        return jump

    def _is_unslowed(self, grown: float) -> bool:
        """Return whether a wave that has grown by a factor takes up as much mix per travel as at its fastest."""
        if len(self._waves) < MIN_WAVES or self._is_low(self._waves[-1]):
            return False
        first, last = self._waves[0], self._waves[-1]
        fastest = max(wave.growth for wave in self._waves)
        return last.wave_area > grown * first.wave_area and last.growth > max(SLOWING * fastest, 0.0)

    def _is_endless(self) -> bool:
        """Return whether a wave at the end of a search takes up mix, and grows by mass or area as at its fastest.

        After a jump the mass is disturbed, and the area is not.
        """
        slopes = [wave.wave_slope for wave in self._waves]
        grows = len(slopes) >= MIN_WAVES and slopes[-1] > SLOWING * max(slopes) and self._waves[-1].growth > 0
        return self._is_unslowed(1.0) or (grows and not self._is_low(self._waves[-1]))

    def _heaping_error(self, wave: str) -> HeapingError:
        """Return the error of a wave without end, with a clause about it, and the share of the feed in it."""
        rolling, step, depth = self.rolling, self.rolling.steps[-1], self.rolling.depth
        share = 100 * self._waves[-1].growth / rolling.frame.mesh.height
        edge = np.clip((depth + step.bow_wave) / rolling.surface.radius, 0.0, 2.0)
        return HeapingError(
            f"the mix heaps up in front of the roller at depth {1e3 * depth:.4g} mm: after {step.travel:.3g} m of "
            f"travel the bow wave {wave}, and takes up {share:.2g} % of the feed; {step}",
            Heaping(depth, float(np.arccos(1 - edge)), step.bow_wave, step.travel),
        )

    def require_steady(self) -> None:
        """Require a steady motion on the target.

        Raises
        ------
        UnsteadyError
            If the search has not decided whether the motion becomes steady, or two meshes have different states.
        RuntimeError
            If it is steady, but at no depth that satisfies the target.
        """
        change = 0.0 if not self._waves or self._is_low(self._waves[-1]) else abs(self._change_by_mesh)
        if self.is_steady and change < MAX_DISTANCE:
            if self._missed:
                raise RuntimeError(self._missed)
            return
        step, distance = self.rolling.steps[-1], min(max(self.distance, change), 1.0)
        message = (
            f"not steady at depth {1e3 * self.depth:.4g} mm after {step.travel:.3g} m of travel, and not decided "
            f"whether it becomes so: estimated distance {100 * distance:.3g} % of load, resistance or exit density; "
            f"{step}"
        )
        raise UnsteadyError(
            message, Unsteady(self.depth, step.bow_wave, step.travel, distance, step.load, step.resistance)
        )

    def _require_slowing(self) -> None:
        """Require a wave that has grown much to have slowed down, and any wave to stay below the contact angle."""
        rolling = self.rolling
        if self._is_unslowed(GROWN):
            raise self._heaping_error("grows without slowing down")
        limit = rolling.max_wave_height - rolling.depth
        if rolling.steps[-1].bow_wave >= limit:
            raise EquilibriumError(
                f"the bow wave exceeds {1e3 * limit:.3g} mm, at which the contact angle is too large"
            )

    def _correct(self, depth: float, jump: float) -> None:
        """Jump along the mode and settle at a corrected depth; by less if a step has no equilibrium."""
        before, ratio = copy(self.rolling), depth / self.depth
        area = before.steps[-1].wave_area
        if abs(np.log(ratio)) > SAME_DEPTH:
            self._settled, self._waves = None, ()
            jump += (area + jump) * (ratio**WAVE_EXPONENT - 1)
            self.relaxation = self.relaxation.at_depth(ratio)
        self.depth, jump = depth, float(np.clip(jump, -LENGTH_ERROR * area, LENGTH_ERROR * area))
        for trial in JUMP_TRIALS:
            self.rolling = copy(before)
            if self.relaxation.mode is not None and trial:
                self.relaxation.mode.add_to(self.rolling, trial * jump)
            self.rolling.remove_marks_behind()
            self._fit_mesh(is_similar=bool(trial))
            try:
                return self._settle()
            except EquilibriumError:
                if not trial:
                    raise

    def _finish(self, jump: float) -> float:
        """Make the last jump and steps to the full tolerance; return the prescribed quantity on the mesh then."""
        if jump:
            self._correct(self.depth, jump)
        missing = FINAL_TRAVEL - (len(self.rolling.steps) - self._begin) * self.rolling.frame.step / self._length
        if missing > 0:
            self._roll(missing)
        self._advance_exactly()
        quantity, count = self.target.quantity, 1
        if quantity == "indentation":
            return self.depth
        if quantity == "exit_density_ratio":  # a mean, since columns of points scatter
            count = self._steps_of(CYCLE / 2)
        return float(np.mean([getattr(step, quantity) for step in self.rolling.steps[-count:]]))

    def _advance_exactly(self) -> None:
        """Make steps to the full tolerance, in which the multipliers of the contact converge, the last undamped."""
        self.rolling.solver.tolerance = ROLLING_TOLERANCE
        for damping in [*[FINAL_DAMPING_RATIO * DAMPING] * (EXACT_STEPS - 1), 0.0]:
            self.rolling.advance(self._height, damping)

    @property
    def _height(self) -> float:
        """Height of the lowest generatrix [m]."""
        return self.rolling.frame.mesh.height - self.depth

    @property
    def _length(self) -> float:
        """Contact length, or a third of the height of a much higher layer [m]."""
        return max(self.rolling.frame.contact_length, HEIGHT_SHARE * self.rolling.frame.mesh.height)

    def _steps_of(self, share: float) -> int:
        """Return the number of steps in a share of the contact length."""
        return max(int(np.ceil(share * self._length / self.rolling.frame.step)), MIN_STEPS)

    def _target_value(self) -> float:
        """Return the steady value of the prescribed quantity on the mesh."""
        quantity = self.target.quantity
        return self.depth if quantity == "indentation" else float(self.values[QUANTITIES.index(quantity)])

    @property
    def _target_factor(self) -> float:
        """Reported over computed value of the prescribed quantity [-]."""
        return self.load_factor if self.target.quantity == "load" else 1.0

    def _fit_mesh(self, is_similar: bool) -> None:
        """Fit the mesh to a depth that differs much from its own, with a similar or the same state, and the rate."""
        length = self.rolling.frame.contact_length
        stretching = self.depth / (length**2 / (2 * self.rolling.surface.radius))
        if max(stretching, 1 / stretching) > STRETCHED_DEPTH:
            if is_similar:
                self.rolling = self.case.stretched(self.rolling, self.depth)
            else:
                frame = self.case.create_frame(self.depth, round(self.elements))
                self._continue_on(self.case.roller_at_rest(frame, len(self.rolling.parts)))
        self.rolling.frame.solid.rate_factor = self.case.rate_factor(self.depth)

    def error_parts(self, mesh: tuple[float, float] | None) -> ErrorParts:
        """Return the relative errors of load and resistance at what is prescribed, with those by the mesh [-].

        The extrapolated load has the errors of what is compared on both meshes, times its weight in it.
        """
        load, resistance = np.abs(self.values[:2]).tolist()
        parts = [each[:2] / [load, resistance_scale(resistance, load)] for each in (self.drift, self.start)]
        if self.coarse is not None and self.load_factor != 1:
            weight, coarse = 1 / (self.increments / self.coarse.increments - 1), self.coarse
            firsts, others = self.first[1:, 0] / self.first[0, 0], [coarse.drift[0], coarse.start[0]] / coarse.values[0]
            for part, first, other in zip(parts, firsts, others, strict=True):
                part[0] = np.hypot(part[0] + weight * first, weight * other)
        parts[1] += DEPTH_EXPONENTS * abs(self._miss) / (self._depth_exponent or 1.0)  # at another depth
        if self.target.quantity == "load":  # the depth takes over the error of the load
            for part in parts:
                part[:] = 0.0, part[1] + DEPTH_EXPONENTS[1] / DEPTH_EXPONENTS[0] * part[0]
        drift, start = ((float(part[0]), float(part[1])) for part in parts)
        return ErrorParts(mesh, drift, start)
