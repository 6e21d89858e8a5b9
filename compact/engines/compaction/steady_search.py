"""Search for the steady state of a roller on one mesh, for a prescribed depth, load, peak pressure or density.

A cycle rolls until the transient of the last change has passed, measures the drift of the bow wave, and corrects wave
and depth together (`steady_state`): the wave by a jump along its slow mode, the depth by a secant method for the
extrapolated steady state. The search ends when the estimated distance to the steady state is below the tolerance and
the target is satisfied. A wave that requires ever larger jumps has no steady state.

The error of a result has three parts:

    mesh    change between the last two meshes over (fine/coarse)^order - 1, with order 1 for the load and 1.5 for the
            resistance at a given depth; at least half of what the change of the bow wave makes, since the forces of two
            meshes may agree by chance. Ten random lifts, 14 against 24 elements per contact length, bound the orders.
    drift   distance to the steady state along the slow mode, before the last jump
    start   scatter of that distance, and the transient that is not part of the mode

At a given load, peak pressure or density both meshes are compared at the prescribed value. The resistance then takes
over the drift of the load, times its exponent.

The wave of mix with a shear line (`DruckerPragerCap`) differs much from mesh to mesh and has no single slow mode: jumps
and a changed rear excite others, which take longer to decay than the wave itself. Bands of shear also form and pass
under the roller, so that load and resistance of a high wave fluctuate by a few per cent about their steady mean. The
roller therefore rolls on until the second half of the travel shows neither drift nor more scatter than the tolerance,
or to a largest travel, with both in the error estimate:

    drift   change along a straight line through the second half of the travel; what is left of an exponential
            relaxation is about as much
    start   twice the standard deviation from that line, or the distance of the last state from it

A residual of `SETTLING_TOLERANCE` suffices up to half a per cent, since it is random from step to step where nothing
restarts; half of the Newton iterations remain. A wave that takes up most of the
mix above the lowest generatrix or grows threefold, without slowing down, or that still grows by a third in the second
half of the largest travel on the first mesh, has no steady state.
"""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np

from compact.engines.compaction.finite_strain_solid import FloatArray
from compact.engines.compaction.roller_frame import transfer_state
from compact.engines.compaction.rolling import DAMPING, FINAL_DAMPING_RATIO, ROLLING_TOLERANCE, IncrementalRolling
from compact.engines.compaction.steady_state import (
    QUANTITIES,
    BowWaveMode,
    DepthSecant,
    DepthTarget,
    ErrorParts,
    Relaxation,
    SteadyErrors,
    WaveDrift,
    WaveGrowth,
    crossing_length,
    relaxation_length,
)
from compact.material.laws import Compaction, DruckerPragerCap
from compact.rolling_contact import EquilibriumError, Unsteady, UnsteadyError

FIRST_SETTLING, FIRST_MEASURING = 1.33, 1.0  # [-], travel over the contact length of the first cycle; new depths
SETTLING, MEASURING = 0.8, 0.7  # [-], of the later cycles
FINAL_SETTLING = 2.0  # [-], after the last jump; the mix of the exit column has then passed the whole contact
HEIGHT_SHARE = 1 / 3  # [-], of the layer height, which counts as contact length at least; later passes are that short
MIN_STEPS = 4  # [-], of a measurement
MAX_FIRST_CYCLES, MAX_CYCLES = 20, 10  # [-], of the first mesh and of others; up to 7 and 5 are usual
MAX_JUMP, MAX_FIRST_JUMP = 0.25, 0.35  # [-], change of the wave by one jump over its area, on the first mesh more
LENGTH_ERROR = 0.5  # [-], relative error of the relaxation length, which jumps then leave
SETTLING_TOLERANCE = 1e-2  # [-], residual of a step over the nodal forces; 1e-4 changes a load by 4e-5
FINAL_TOLERANCE = 1e-3  # [-], of those near the steady state, whose scatter counts; of the last `ROLLING_TOLERANCE`
EXACT_STEPS = 4  # [-], last steps; the gap in the contact is then below 1e-5 of the depth
NEAR = 4.0  # [-], estimated distance from the steady state over its tolerance
JUMP_TRIALS = (1.0, 0.4, 0.0)  # [-], shares of a jump that are tried in turn if a later step has no equilibrium
FIRST_LENGTH = 5.0  # [-], relaxation length of the wave over the contact length before any is known
LENGTH_RANGE = (2.0, 40.0)  # [-], relaxation length over the contact length
MIN_CROSSING = 0.2  # [-], least relaxation length between waves that grow and decay, over the last length
MIN_MODE = 0.02  # [-], least change of the wave between two settled states that define a mode, over the wave
MIN_WAVE = 0.1  # [-], least area of a wave over depth and contact length whose mode counts; lower ones are scatter
SIGNIFICANCE = 3.0  # [-], standard errors from which a change of the wave counts
WAVE_EXPONENT = 3.4  # [-], of the area of the wave over the depth, roughly
SAME_DEPTH = 1e-3  # [-], relative change of the depth below which settled states belong to one depth
STRETCHED_DEPTH = 1.25  # [-], ratio of a depth to that of the mesh from which the mesh is stretched
MIN_ERROR_SCALE = 1e-3  # [-], least scale of the error of the resistance over the load
DEPTH_EXPONENTS = np.array([1.2, 2.3, 1.0, 0.6])  # [-], of `QUANTITIES` over the depth; of the density: its increase
ORDERS = np.array([1.0, 1.5])  # [-], of load and resistance in the element length
WAVE_SHARE = 0.5  # [-], of the change of a force by that of the wave, the least change between two meshes
# of mix with a shear line
CYCLE = 2.0  # [-], travel of a cycle over the contact length
MIN_CYCLES, MIN_WAVE_CYCLES = 2, 4  # [-], of a mesh, and of one with a wave
MAX_FIRST_STEPS, MAX_COARSE_STEPS, MAX_STEPS = 270, 170, 450  # [-], of the first mesh, of those between, of the last
COARSE_ERROR = 0.02  # [-], estimated distance from the steady state at which a coarse mesh has served
ACCEPTED_ERRORS = ((220, 0.05), (330, 0.15))  # [-], steps on the last mesh after which this distance is accepted
FINAL_SHARE = 0.5  # [-], travel over the contact length with `FINAL_TOLERANCE` at the end
SCATTER = 2.0  # [-], standard deviations of the last state from the steady mean
GROWTH, SLOWING = 0.3, 0.8  # [-], of the wave in the last half of the travel, and of its slope over the largest one
GROWN = 3.0  # [-], area of a wave over that of the first cycle, beyond which it must slow down
MAX_ERROR = 0.2  # [-], estimated distance from the steady state beyond which there is no answer
PLOUGHED = 0.8  # [-], growth of the wave over the depth, from which most of the mix in the way is pushed ahead
TARGET_ERROR = 0.05  # [-], estimated distance below which the depth is corrected for a target
MIN_TARGET_CYCLES = 6  # [-], cycles after which it is corrected anyway


@dataclass
class SteadySearch:
    """Search for the steady state on one mesh.

    Parameters
    ----------
    rolling : IncrementalRolling
        Roller at rest or in any state; replaced where the mesh is stretched.
    target : DepthTarget
        Prescribed quantity.
    depth : float
        First depth [m].
    tolerance : float
        Largest estimated distance from the steady state [-].
    target_tolerance : float
        Tolerance of the logarithm of the prescribed quantity [-].
    stretch : callable
        Function that returns a roller on its mesh stretched to a depth [m].
    relaxation : Relaxation
        Slow relaxation of the bow wave; its length is found on this mesh if it is unknown.
    rate_factor : callable, optional
        Function that returns the factor of the yield pressure [-] at a depth [m]; that of the mesh by default.
    is_last : bool
        True on the mesh of the result, False on those that provide its initial state.
    """

    rolling: IncrementalRolling
    target: DepthTarget
    depth: float
    tolerance: float
    target_tolerance: float
    stretch: Callable[[IncrementalRolling, float], IncrementalRolling]
    relaxation: Relaxation = field(default_factory=Relaxation)
    rate_factor: Callable[[float], float] | None = None
    is_last: bool = True
    errors: SteadyErrors = field(init=False)
    values: FloatArray = field(init=False)  # `QUANTITIES` in the steady state
    finds_length: bool = field(init=False)
    _density_factor: float = field(default=1.0, init=False)
    _depth_exponent: float | None = field(default=None, init=False)
    _drifts: list[WaveDrift] = field(default_factory=list, init=False)
    _settled: IncrementalRolling | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        self.finds_length = self.relaxation.length is None

    def start_from(self, coarse: "SteadySearch") -> None:
        """Start from the steady state on a coarser mesh."""
        old, new = coarse.rolling, self.rolling
        new.initialise_from(old, transfer_state(old.state, old.frame, new.frame))
        mode, first = coarse.relaxation.mode, coarse.relaxation.first_length
        self.relaxation = Relaxation(first, None if mode is None else mode.on_mesh(old, new), first)
        self.finds_length = first is None
        self._density_factor, self._depth_exponent = coarse._density_factor, coarse._depth_exponent

    def run(self) -> None:
        """Find the steady state; `rolling`, `depth`, `values` and `errors` then belong to it.

        Raises
        ------
        HeapingError
            If the bow wave grows without end.
        UnsteadyError
            If the motion does not become steady.
        RuntimeError
            If a step has no equilibrium, or the target is not reached.
        """
        growth = WaveGrowth()
        try:
            self._find_steady_state(growth)
        except EquilibriumError as error:
            if growth.is_unslowed:
                raise self.rolling.heaping_error("grows without slowing down until a step fails") from error
            raise

    def _find_steady_state(self, growth: WaveGrowth) -> None:
        """Roll in cycles until the motion is steady and the target satisfied; record the growth of the wave."""
        secant = DepthSecant(self.target, self._depth_exponent)
        self.rolling.solver.tolerance = SETTLING_TOLERANCE
        self._roll(FIRST_SETTLING, DAMPING)
        for cycle in range(MAX_FIRST_CYCLES if self.finds_length else MAX_CYCLES):
            drift = self._measure(FIRST_MEASURING if cycle == 0 else MEASURING)
            jump = self._estimate(drift)
            growth.record(drift, jump)
            if growth.is_endless:
                raise self.rolling.heaping_error("grows without a steady state")
            is_near, is_final, depth = self.errors.total < NEAR * self.tolerance, False, self.depth
            if is_near:  # the depth waits for the wave, since corrections of both at once oscillate
                corrected = secant.next_depth(depth, self._target_value())
                self._depth_exponent = secant.slope
                is_met = abs(secant.last_miss) < self.target_tolerance
                depth, is_final = depth if is_met else corrected, is_met and self.errors.total < self.tolerance
            self.rolling.solver.tolerance = FINAL_TOLERANCE if is_near else SETTLING_TOLERANCE
            settling = SETTLING if depth == self.depth else FIRST_SETTLING
            self._correct(depth, jump, FINAL_SETTLING if is_final else settling)
            if is_final:
                self._advance_exactly()
                last = self.rolling.steps[-1]
                if abs(self.target.log_miss_of(last)) < self.target_tolerance:
                    return
                if self.target.quantity == "exit_density_ratio":
                    self._density_factor = last.exit_density_ratio / self._geometric_density_ratio()
                    secant = DepthSecant(self.target, secant.slope)  # earlier values had another factor
        if self.errors.total < self.tolerance and secant.is_started:
            raise RuntimeError(secant.failure())
        raise self._unsteady_error()

    def _advance_exactly(self) -> None:
        """Make steps to the full tolerance, in which the multipliers of the contact converge, the last undamped."""
        self.rolling.solver.tolerance = ROLLING_TOLERANCE
        for damping in [*[FINAL_DAMPING_RATIO * DAMPING] * (EXACT_STEPS - 1), 0.0]:
            self.rolling.advance(self._height, damping)
        self.rolling.solver.tolerance = FINAL_TOLERANCE

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

    def _roll(self, share: float, damping: float = FINAL_DAMPING_RATIO * DAMPING) -> None:
        """Roll a share of the contact length at the present depth, which the first half of the steps approaches."""
        rolling, count = self.rolling, self._steps_of(share)
        start = rolling.steps[-1].bottom_height if rolling.steps else rolling.frame.mesh.height
        approach = np.linspace(start, self._height, 1 + (2 * count if not rolling.steps else max(count // 2, 1)))[1:]
        for height in [*approach, *[self._height] * max(count - len(approach), count // 2)]:
            rolling.advance(float(height), damping)
        limit = rolling.max_wave_height - rolling.depth
        if rolling.steps[-1].bow_wave >= limit:
            raise rolling.heaping_error(f"exceeds {1e3 * limit:.3g} mm, at which the contact angle is too large")

    def _measure(self, share: float) -> WaveDrift:
        """Roll on, fit the drift, and update relaxation length and mode from the settled states."""
        begin, count = copy(self.rolling), self._steps_of(share)
        self._roll(share)
        drift = WaveDrift.of_steps(self.rolling.steps[-count - 1 :])
        first, before = (begin, None) if self._settled is None else (self._settled, self._drifts[-1])
        self._drifts.append(drift)

        # fit the relaxation length, or on a finer mesh shorten it where two waves bracket the steady one
        known = self.relaxation.length
        if self.finds_length or known is None:
            found = relaxation_length(self._drifts)
            bounds = np.multiply(LENGTH_RANGE, self.rolling.frame.contact_length)
        else:
            found, bounds = crossing_length(self._drifts), np.array([MIN_CROSSING * known, known])
        if found is not None:
            length = float(np.clip(found, *bounds))
            self.relaxation = replace(
                self.relaxation,
                length=length,
                first_length=length if self.finds_length else self.relaxation.first_length,
            )

        # take the difference of two settled states of one depth as mode if the wave has changed beyond its scatter
        change = self.rolling.steps[-1].wave_area - first.steps[-1].wave_area
        is_significant = abs(change) >= max(MIN_MODE * drift.wave_area, SIGNIFICANCE * drift.wave_error * drift.travel)
        if is_significant and not self._is_low(drift) and (before is not None or self.relaxation.mode is None):
            if before is None:
                slopes = drift.slopes / drift.wave_slope
            else:
                slopes = (drift.values - before.values) / (drift.wave_area - before.wave_area)
            self.relaxation = replace(self.relaxation, mode=BowWaveMode.between(first, self.rolling, slopes))
        self._settled = copy(self.rolling)
        return drift

    def _is_low(self, drift: WaveDrift) -> bool:
        """Return whether a wave is too low to count."""
        return drift.wave_area < MIN_WAVE * self.depth * self.rolling.frame.contact_length

    def _estimate(self, drift: WaveDrift) -> float:
        """Estimate steady values and errors; return the distance of the area of the wave to its steady value [m2]."""
        known, contact_length = self.relaxation, self.rolling.frame.contact_length
        length = FIRST_LENGTH * contact_length if known.length is None else known.length
        slopes = np.zeros(len(QUANTITIES)) if known.mode is None else known.mode.slopes
        jump, scatter = length * drift.wave_slope, length * drift.wave_error
        if abs(drift.wave_slope) < SIGNIFICANCE * drift.wave_error:
            jump = 0.0
        self.values = drift.values + slopes * jump
        transient = self._length * np.abs(drift.slopes - slopes * drift.wave_slope)
        self.errors = SteadyErrors(
            LENGTH_ERROR * np.abs(slopes * jump), np.abs(slopes) * scatter + transient, drift.values
        )
        return jump

    def _target_value(self) -> float:
        """Extrapolated steady value of the prescribed quantity."""
        quantity = self.target.quantity
        if quantity == "indentation":
            return self.depth
        if quantity == "exit_density_ratio":
            if self.rolling.frame.has_frictionless_base:
                self._density_factor = float(self.values[2]) / self._geometric_density_ratio(at_exit=True)
            return self._density_factor * self._geometric_density_ratio()
        return float(self.values[QUANTITIES.index(quantity)])

    def _geometric_density_ratio(self, at_exit: bool = False) -> float:
        """Density ratio of the fed mix in the height of the layer behind the roller at the present depth [-].

        With `at_exit` the depth is that at which the roller has passed the exit column.

        The height is that of the roller and the recovery at the exit column, which the roller has passed before; the
        density ratio of that column lags behind the depth. They differ by elastic strain and by elongation, which on a
        frictionless base is as large as the increase of the density.
        """
        rolling, frame = self.rolling, self.rolling.frame
        x, y = rolling.surface_positions.T
        passed = rolling.steps[-min(int(frame.exit_distance / frame.step) + 1, len(rolling.steps))]
        recovery = float(np.interp(-frame.exit_distance, x, y)) - passed.bottom_height
        bottom = frame.layer_bottom(rolling.state.displacement, -frame.exit_distance)
        height = frame.mesh.height - frame.lower_height
        bottom_height = passed.bottom_height if at_exit else self._height
        return self.target.fed_ratio * height / (bottom_height + recovery - bottom)

    def _correct(self, depth: float, jump: float, share: float) -> None:
        """Jump along the mode and roll at a corrected depth; by less if a step has no equilibrium."""
        before, ratio = copy(self.rolling), depth / self.depth
        area = before.steps[-1].wave_area
        if abs(np.log(ratio)) > SAME_DEPTH:
            self._settled, self._drifts = None, []
            jump += (area + jump) * (ratio**WAVE_EXPONENT - 1)
            self.relaxation = self.relaxation.at_depth(ratio)
        self.depth = depth
        largest = area * (MAX_FIRST_JUMP if self.finds_length else MAX_JUMP)
        jump = float(np.clip(jump, -largest, largest))
        for trial in JUMP_TRIALS:
            self.rolling = copy(before)
            if self.relaxation.mode is not None and trial:
                self.relaxation.mode.add_to(self.rolling, trial * jump)
            self.rolling.remove_marks_behind()
            self._fit_mesh()
            try:
                return self._roll(share)
            except RuntimeError:
                if not trial:
                    raise

    def _fit_mesh(self) -> None:
        """Stretch the mesh to a depth that differs much from its own, and update the rate factor."""
        stretching = self.depth / self.rolling.mesh_depth
        if max(stretching, 1 / stretching) > STRETCHED_DEPTH:
            self.rolling = self.stretch(self.rolling, self.depth)
        if self.rate_factor is not None:
            self.rolling.frame.solid.rate_factor = self.rate_factor(self.depth)

    def _unsteady_error(self) -> UnsteadyError:
        """Return the error of a motion that does not become steady."""
        step, distance = self.rolling.steps[-1], self.errors.total
        message = (
            f"not steady at depth {1e3 * self.depth:.4g} mm after {step.travel:.3g} m of travel: estimated distance "
            f"{100 * distance:.2g} % of load, resistance or exit density; {step}"
        )
        unsteady = Unsteady(self.depth, step.bow_wave, step.travel, distance, step.load, step.resistance)
        return UnsteadyError(message, unsteady)

    def error_parts(self, mesh: tuple[float, float] | None) -> ErrorParts:
        """Return the relative errors of load and resistance at what is prescribed, with those by the mesh [-]."""
        parts = []
        for errors in (self.errors.drift, self.errors.start):
            load, resistance = (float(error) for error in errors[:2] / self._error_scales)
            if self.target.quantity == "load":
                load, resistance = 0.0, resistance + float(DEPTH_EXPONENTS[1] / DEPTH_EXPONENTS[0]) * load
            parts.append((load, resistance))
        return ErrorParts(mesh, *parts)

    @property
    def _error_scales(self) -> FloatArray:
        """Load and resistance, the latter not too small, as scales of their errors [N/m], shape (2,)."""
        load, resistance = np.abs(self.values[:2])
        return np.array([load, max(resistance, MIN_ERROR_SCALE * load)])


class ShearLineSearch(SteadySearch):
    """Search for the steady state on one mesh for mix with a shear line; parameters as of `SteadySearch`."""

    _begin: int = 0
    _waves: tuple[WaveDrift, ...] = ()

    def _find_steady_state(self, growth: WaveGrowth) -> None:
        """Roll in cycles until the motion is steady and the target satisfied; record the growth of the wave."""
        secant = DepthSecant(self.target, self._depth_exponent)
        from_rest, first, self._waves = not self.rolling.steps, len(self.rolling.steps), ()
        max_steps = MAX_STEPS if self.is_last else MAX_FIRST_STEPS if from_rest else MAX_COARSE_STEPS
        self.rolling.solver.tolerance = SETTLING_TOLERANCE
        self._roll(FIRST_SETTLING, DAMPING)
        self._begin = len(self.rolling.steps) - 1
        cycle, count = 0, 0
        while count < max_steps:
            self._roll(CYCLE)
            cycle, count = cycle + 1, len(self.rolling.steps) - first
            drift = self._estimate_distance()
            self._require_slowing(growth)
            is_near = self.errors.total < TARGET_ERROR or cycle >= MIN_TARGET_CYCLES
            is_met = is_near and self._correct_depth(secant)
            if cycle < (MIN_CYCLES if self._is_low(drift) else MIN_WAVE_CYCLES):
                continue
            accepted = [error for least, error in ACCEPTED_ERRORS if count >= least]
            if is_met and self.errors.total < (max(self.tolerance, *accepted, 0.0) if self.is_last else COARSE_ERROR):
                break
            is_coarse = self.rolling.solver.tolerance > FINAL_TOLERANCE
            if self.is_last and is_coarse and self.errors.total < NEAR * self.tolerance:
                # measure the drift from here with the scatter of a smaller residual
                self.rolling.solver.tolerance, self._begin = FINAL_TOLERANCE, len(self.rolling.steps) - 1

        is_steady, wave = self.errors.total < MAX_ERROR, self._waves[-1] if self._waves else None
        half = (self.rolling.steps[-1].travel - self.rolling.steps[self._begin].travel) / 2
        if not is_steady and from_rest and wave is not None and wave.wave_slope * half > GROWTH * wave.wave_area:
            raise self.rolling.heaping_error("still grows")
        if self.is_last and not is_steady:
            raise self._unsteady_error()
        if self.is_last and not self._is_met(secant):
            raise RuntimeError(secant.failure())
        if self.is_last:
            self._finish()

    def _estimate_distance(self) -> WaveDrift:
        """Return the drift in the second half of the travel; set steady values and errors by it."""
        steps = self.rolling.steps[self._begin :]
        steps = steps[len(steps) // 2 :]
        drift = WaveDrift.of_steps(steps)
        table = np.array([[getattr(step, name) for name in QUANTITIES] for step in steps])
        travel = np.array([step.travel for step in steps]) - steps[-1].travel
        scatter = SCATTER * (table - drift.values - travel[:, None] * drift.slopes).std(axis=0)
        start = np.maximum(scatter, np.abs(table[-1] - drift.values))
        self.values = drift.values
        self.errors = SteadyErrors(np.abs(drift.slopes) * drift.travel, start, drift.values)
        return drift

    def _require_slowing(self, growth: WaveGrowth) -> None:
        """Require that a wave that has grown threefold has slowed down."""
        count = self._steps_of(CYCLE)
        self._waves += (WaveDrift.of_steps(self.rolling.steps[-count - 1 :]),)
        first, last = self._waves[0], self._waves[-1]
        fastest = max(wave.wave_slope for wave in self._waves)
        growth.slopes = [] if self._is_low(last) else [fastest, last.wave_slope]
        if last.wave_slope <= max(SLOWING * fastest, 0.0) or len(self._waves) <= MIN_CYCLES:
            return
        if last.wave_slope > PLOUGHED * self.depth:
            pushed = f"grows by {100 * last.wave_slope / self.depth:.0f} % of the depth times the travel"
            raise self.rolling.heaping_error(f"{pushed}, without slowing down")
        if last.wave_area > GROWN * first.wave_area and not self._is_low(last):
            raise self.rolling.heaping_error("has grown threefold without slowing down")

    def _correct_depth(self, secant: DepthSecant) -> bool:
        """Return whether the target is satisfied; else change the depth, and measure the drift from there."""
        quantity = self.target.quantity
        value = self.depth if quantity == "indentation" else float(self.values[QUANTITIES.index(quantity)])
        depth = secant.next_depth(self.depth, value)
        self._depth_exponent = secant.slope
        if self._is_met(secant):
            return True
        self.depth, self._waves = depth, ()
        self._fit_mesh()
        self._roll(CYCLE)
        self._begin = len(self.rolling.steps) - 1
        return False

    def _is_met(self, secant: DepthSecant) -> bool:
        """Return whether the target is satisfied to its tolerance, or to the scatter of the quantity."""
        scatter = 0.0
        if self.target.quantity != "indentation":
            index = QUANTITIES.index(self.target.quantity)
            value, error = float(self.values[index]), float(self.errors.start[index])
            scatter = abs(self.target.log_miss(value + error) - self.target.log_miss(value))
        return abs(secant.last_miss) < max(self.target_tolerance, scatter)

    def _finish(self) -> None:
        """Roll the last steps to the full tolerance; the distance of the last one from the mean is an error too."""
        self.rolling.solver.tolerance = FINAL_TOLERANCE
        self._roll(FINAL_SHARE)
        self._advance_exactly()
        distance = np.abs([getattr(self.rolling.steps[-1], name) for name in QUANTITIES] - self.values)
        self.errors = replace(self.errors, start=np.maximum(self.errors.start, distance))


def search_class(material: Compaction) -> type[SteadySearch]:
    """Return the search for the steady state of a constitutive law."""
    return ShearLineSearch if isinstance(material, DruckerPragerCap) else SteadySearch


def mesh_errors(coarse: SteadySearch, fine: SteadySearch, coarsest: SteadySearch | None = None) -> tuple[float, float]:
    """Return the relative errors of load and resistance by the mesh from the solutions on two of them [-].

    On a shear line the resistance is of first order too, and not monotone: its error is at least that by the two
    coarser meshes, less by the ratio of the last two.

    Parameters
    ----------
    coarse, fine : SteadySearch
        Searches that have found the steady state.
    coarsest : SteadySearch, optional
        Search on the mesh before these two.
    """
    has_line = isinstance(fine.rolling.frame.solid.material, DruckerPragerCap)
    by_depth = fine.target.quantity != "load" and not has_line  # at a given load F takes over the order of the load
    orders = ORDERS if by_depth else ORDERS[:1]
    errors = _change_to(coarse, fine, orders)
    if has_line and coarsest is not None:
        ratio = coarse.rolling.frame.step / fine.rolling.frame.step
        errors = np.maximum(errors, _change_to(coarsest, coarse, orders) / ratio)
    return float(errors[0]), float(errors[1])


def _change_to(coarse: SteadySearch, fine: SteadySearch, orders: FloatArray) -> FloatArray:
    """Return the relative errors of load and resistance by the change between two meshes [-], shape (2,)."""
    elements = [search.rolling.frame.contact_length / search.rolling.frame.step for search in (coarse, fine)]
    quantity, values = fine.target.quantity, coarse.values  # at the prescribed value of the fine mesh
    if quantity == "exit_density_ratio":  # prescribes the depth; the density of a column lags behind it
        values = values * (fine.depth / coarse.depth) ** DEPTH_EXPONENTS
    elif quantity != "indentation":
        index = QUANTITIES.index(quantity)
        miss = coarse.target.log_miss(float(values[index])) - fine.target.log_miss(float(fine.values[index]))
        values = values * np.exp(-miss * DEPTH_EXPONENTS / DEPTH_EXPONENTS[index])
    change, mode = np.abs(values - fine.values), fine.relaxation.mode
    if mode is not None and quantity == "indentation":
        wave = fine.rolling.steps[-1].wave_area - coarse.rolling.steps[-1].wave_area
        change = np.maximum(change, WAVE_SHARE * np.abs(mode.slopes * wave))
    remaining = 1 / ((elements[1] / elements[0]) ** orders - 1)
    return np.asarray(remaining * change[:2] / fine._error_scales)
