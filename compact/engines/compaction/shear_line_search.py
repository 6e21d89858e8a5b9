"""Search for the steady state of mix with a shear line, by rolling without interruption.

The wave of a `DruckerPragerCap` differs much from mesh to mesh and has no single slow mode: jumps and a changed rear
excite others, which take longer to decay than the wave itself. Bands of shear also form and pass under the roller, so
that load and resistance of a high wave fluctuate by a few per cent about their steady mean. The roller therefore rolls
on until the second half of the travel shows neither drift nor more scatter than the tolerance, or to a largest travel,
with both in the error estimate:

    drift   change along a straight line through the second half of the travel; what is left of an exponential
            relaxation is about as much
    start   twice the standard deviation from that line, or the distance of the last state from it

A residual of `SETTLING_TOLERANCE` suffices up to half a per cent, since it is random from step to step where nothing
restarts; half of the Newton iterations remain. The last state is one near the mean. A wave that takes up most of the
mix above the lowest generatrix or grows threefold, without slowing down, or that still grows by a third in the second
half of the largest travel on the first mesh, has no steady state.
"""

from copy import copy
from dataclasses import replace

import numpy as np

from compact.engines.compaction.bow_wave import QUANTITIES, WaveDrift
from compact.engines.compaction.depth_target import DepthSecant
from compact.engines.compaction.finite_strain_solid import FloatArray
from compact.engines.compaction.incremental_rolling import DAMPING, FINAL_DAMPING_RATIO, heaping_error
from compact.engines.compaction.steady_search import (
    FINAL_TOLERANCE,
    FIRST_SETTLING,
    GROWTH,
    MIN_RESISTANCE,
    MIN_WAVE,
    NEAR,
    SETTLING_TOLERANCE,
    SLOWING,
    STRETCHED_DEPTH,
    SteadyErrors,
    SteadySearch,
    WaveGrowth,
)
from compact.material.laws import Compaction, DruckerPragerCap
from compact.rolling_contact import EquilibriumError

CYCLE = 2.0  # [-], travel of a cycle over the contact length
MIN_CYCLES, MIN_WAVE_CYCLES = 2, 4  # [-], of a mesh, and of one with a wave
MAX_FIRST_STEPS, MAX_COARSE_STEPS, MAX_STEPS = 270, 170, 450  # [-], of the first mesh, of those between, of the last
COARSE_ERROR = 0.02  # [-], estimated distance from the steady state at which a coarse mesh has served
ACCEPTED_ERRORS = ((220, 0.05), (330, 0.15))  # [-], steps on the last mesh after which this distance is accepted
FINAL_SHARE = 0.5  # [-], travel over the contact length with `FINAL_TOLERANCE` at the end
SCATTER = 2.0  # [-], standard deviations of the last state from the steady mean
GROWN = 3.0  # [-], area of a wave over that of the first cycle, beyond which it must slow down
MAX_ERROR = 0.2  # [-], estimated distance from the steady state beyond which there is no answer
MEAN_CYCLES, MEAN_SHARE = 2.0, 0.25  # [-], largest travel to a state near the mean, and its distance over the scatter
PLOUGHED = 0.8  # [-], growth of the wave over the depth, from which most of the mix in the way is pushed ahead
TARGET_ERROR = 0.05  # [-], estimated distance below which the depth is corrected for a target
MIN_TARGET_CYCLES = 6  # [-], cycles after which it is corrected anyway
MAX_TRIMS = 12  # [-], steps that trim the depth to a prescribed load or pressure
LARGEST_TRIM = 5e-3  # [-], relative change of the depth by one of them
FIRST_EXPONENT, LEAST_EXPONENT = 5.0, 1.0  # [-], of the load over the depth within a step, which is mostly elastic


def search_class(material: Compaction) -> type[SteadySearch]:
    """Return the search for the steady state of a constitutive law."""
    return ShearLineSearch if isinstance(material, DruckerPragerCap) else SteadySearch


class ShearLineSearch(SteadySearch):
    """Search for the steady state on one mesh for mix with a shear line; parameters as of `SteadySearch`."""

    _begin: int = 0
    _waves: tuple[WaveDrift, ...] = ()

    def _find_steady_state(self, growth: WaveGrowth) -> None:
        """Roll in cycles until the motion is steady and the target satisfied; record the growth of the wave."""
        secant = DepthSecant(self.target, self._depth_exponent)
        from_rest, first, self._waves = not self.rolling.steps, len(self.rolling.steps), ()
        self.rolling.solver.tolerance = SETTLING_TOLERANCE
        self._roll_on(FIRST_SETTLING, DAMPING)
        self._begin = len(self.rolling.steps) - 1
        cycle, count = 0, 0
        while count < self._max_steps(from_rest):
            self._roll_on(CYCLE)
            cycle, count = cycle + 1, len(self.rolling.steps) - first
            drift = self._estimate_distance()
            self._require_slowing(growth)
            is_near = self.errors.total < TARGET_ERROR or cycle >= MIN_TARGET_CYCLES
            is_met = is_near and self._correct_depth(secant)
            if cycle < self._min_cycles(drift):
                continue
            if is_met and self._is_settled(count):
                break
            if self.is_last and self.errors.total < NEAR * self.tolerance:
                self._measure_finely()
        self._require_answer(secant, from_rest=from_rest)
        if self.is_last:
            self._finish()

    def _max_steps(self, from_rest: bool) -> int:
        """Largest number of steps on this mesh."""
        if self.is_last:
            return MAX_STEPS
        return MAX_FIRST_STEPS if from_rest else MAX_COARSE_STEPS

    def _roll_on(self, share: float, damping: float = FINAL_DAMPING_RATIO * DAMPING) -> None:
        """Roll a share of the contact length, with more iterations and damping if a step has no equilibrium."""
        before = copy(self.rolling)
        try:
            self._roll(share, damping)
        except EquilibriumError:
            self.rolling, tolerance = before, self.rolling.solver.tolerance
            self.rolling.solver.tolerance, self.rolling.solver.solve_tangent = FINAL_TOLERANCE, None
            self._roll(share, DAMPING)
            self.rolling.solver.tolerance = tolerance

    def _estimate_distance(self) -> WaveDrift:
        """Return the drift in the second half of the travel; set steady values and errors by it."""
        steps = self.rolling.steps[self._begin :]
        steps = steps[len(steps) // 2 :]
        drift = WaveDrift.of_steps(steps)
        table = np.array([[getattr(step, name) for name in QUANTITIES] for step in steps])
        travel = np.array([step.travel for step in steps]) - steps[-1].travel
        scatter = SCATTER * (table - drift.values - travel[:, None] * drift.slopes).std(axis=0)
        load, resistance = np.abs(drift.values[:2])
        start = np.maximum(scatter, np.abs(table[-1] - drift.values))
        scales = float(load), float(max(resistance, MIN_RESISTANCE * load))
        self.values, self.errors = drift.values, SteadyErrors(np.abs(drift.slopes) * drift.travel, start, *scales)
        return drift

    def _is_settled(self, count: int) -> bool:
        """Return whether the mesh has served, or the motion is steady on the last one, after a number of steps."""
        if not self.is_last:
            return self.errors.total < COARSE_ERROR
        accepted = [error for least, error in ACCEPTED_ERRORS if count >= least]
        return self.errors.total < max(self.tolerance, *accepted, 0.0)

    def _min_cycles(self, drift: WaveDrift) -> int:
        """Least number of cycles."""
        return MIN_CYCLES if self._is_low(drift) else MIN_WAVE_CYCLES

    def _is_low(self, drift: WaveDrift) -> bool:
        """Return whether a wave is too low to count."""
        return drift.wave_area < MIN_WAVE * self.depth * self.rolling.frame.contact_length

    def _measure_finely(self) -> None:
        """Measure the drift from here with the scatter of a smaller residual."""
        if self.rolling.solver.tolerance > FINAL_TOLERANCE:
            self.rolling.solver.tolerance, self._begin = FINAL_TOLERANCE, len(self.rolling.steps) - 1

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
            raise heaping_error(self.rolling, f"{pushed}, without slowing down")
        if last.wave_area > GROWN * first.wave_area and not self._is_low(last):
            raise heaping_error(self.rolling, "has grown threefold without slowing down")

    def _correct_depth(self, secant: DepthSecant) -> bool:
        """Return whether the target is satisfied; else change the depth, and measure the drift from there."""
        depth = secant.next_depth(self.depth, self._target_value())
        self._depth_exponent = secant.slope
        if abs(secant.last_miss) < max(self.target_tolerance, self._target_scatter()):
            return True
        self.depth, self._waves = depth, ()
        stretching = depth / self.rolling.mesh_depth
        if max(stretching, 1 / stretching) > STRETCHED_DEPTH:
            self.rolling = self.stretch(self.rolling, depth)
        if self.rate_factor is not None:
            self.rolling.frame.solid.rate_factor = self.rate_factor(depth)
        self._roll_on(CYCLE)
        self._begin = len(self.rolling.steps) - 1
        return False

    def _target_value(self) -> float:
        """Steady value of the prescribed quantity."""
        if self.target.quantity == "indentation":
            return self.depth
        return float(self.values[QUANTITIES.index(self.target.quantity)])

    def _target_scatter(self) -> float:
        """Scatter of the logarithm of the prescribed quantity over the target [-]."""
        if self.target.quantity == "indentation":
            return 0.0
        index = QUANTITIES.index(self.target.quantity)
        value, scatter = float(self.values[index]), float(self.errors.start[index])
        return abs(self.target.log_miss(value + scatter) - self.target.log_miss(value))

    def _require_answer(self, secant: DepthSecant, *, from_rest: bool) -> None:
        """Require a distance from the steady state that an answer may have, and the target on the last mesh."""
        wave = self._waves[-1] if self._waves else None
        is_steady = self.errors.total < MAX_ERROR
        half = (self.rolling.steps[-1].travel - self.rolling.steps[self._begin].travel) / 2
        if not is_steady and from_rest and wave is not None and wave.wave_slope * half > GROWTH * wave.wave_area:
            raise heaping_error(self.rolling, "still grows")
        if self.is_last and not is_steady:
            raise self._unsteady_error()
        is_met = abs(secant.last_miss) < max(self.target_tolerance, self._target_scatter())
        if self.is_last and not is_met:
            raise RuntimeError(secant.failure())

    def _finish(self) -> None:
        """Roll the last steps to the full tolerance, and trim the depth to a prescribed load or pressure."""
        self.rolling.solver.tolerance = FINAL_TOLERANCE
        self._roll(FINAL_SHARE)
        for _ in range(self._steps_of(MEAN_CYCLES * CYCLE)):
            if self._is_near_mean():
                break
            self.rolling.advance(self._height, FINAL_DAMPING_RATIO * DAMPING)
        self._advance_exactly()
        exponent, target = FIRST_EXPONENT, self.target
        miss = target.log_miss_of(self.rolling.steps[-1])
        for _ in range(MAX_TRIMS if target.quantity in ("load", "peak_pressure") else 0):
            if abs(miss) < target.tolerance:
                break
            change = float(np.clip(-miss / exponent, -LARGEST_TRIM, LARGEST_TRIM))
            self.depth *= np.exp(change)
            self._advance_exactly()
            before, miss = miss, target.log_miss_of(self.rolling.steps[-1])
            exponent = max((miss - before) / change, LEAST_EXPONENT)
        self.errors = replace(self.errors, start=np.maximum(self.errors.start, np.abs(self._last_values - self.values)))

    @property
    def _last_values(self) -> FloatArray:
        """`QUANTITIES` of the last step."""
        return np.array([getattr(self.rolling.steps[-1], name) for name in QUANTITIES])

    def _is_near_mean(self) -> bool:
        """Return whether load and resistance of the last step are those of the steady mean within their scatter."""
        errors = self.errors
        scatter = np.maximum(MEAN_SHARE * errors.start[:2], self.tolerance * np.array([errors.load, errors.resistance]))
        return bool((np.abs(self._last_values - self.values)[:2] < scatter).all())
