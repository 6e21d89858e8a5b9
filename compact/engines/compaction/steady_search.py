"""Search for the steady state of a roller on one mesh, for a prescribed depth, load, peak pressure or density.

A cycle rolls until the transient of the last change has passed, measures the drift of the bow wave (`bow_wave`), and
corrects wave and depth together: the wave by a jump along its slow mode, the depth by a secant method for the
extrapolated steady state (`depth_target`). The search ends when the estimated distance to the steady state is below the
tolerance and the target is satisfied. A wave that requires ever larger jumps has no steady state.

The error of a result has three parts:

    mesh    change between the last two meshes over (fine/coarse)^order - 1, with order 1 for the load and 1.5 for the
            resistance at a given depth; at least half of what the change of the bow wave makes, since the forces of two
            meshes may agree by chance. Ten random lifts, 14 against 24 elements per contact length, bound the orders.
    drift   distance to the steady state along the slow mode, before the last jump
    start   scatter of that distance, and the transient that is not part of the mode

At a given load, peak pressure or density both meshes are compared at the prescribed value. The resistance then takes
over the drift of the load, times its exponent.
"""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np

from compact.engines.compaction.bow_wave import (
    QUANTITIES,
    BowWaveMode,
    Relaxation,
    WaveDrift,
    crossing_length,
    relaxation_length,
)
from compact.engines.compaction.depth_target import DepthSecant, DepthTarget
from compact.engines.compaction.finite_strain_solid import FloatArray
from compact.engines.compaction.incremental_rolling import (
    DAMPING,
    FINAL_DAMPING_RATIO,
    ROLLING_TOLERANCE,
    IncrementalRolling,
    describe_step,
    heaping_error,
    require_low_wave,
)
from compact.engines.compaction.roller_frame import transfer_state
from compact.material.laws import DruckerPragerCap
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
GROWTH, MAX_GROWTHS = 0.3, 7  # [-], required jump over the area, and number of successive ones with a steady state
MAX_UNSLOWED, SLOWING = 2, 0.8  # [-], such jumps if the growth per travel remains above that share of the first one
FIRST_LENGTH = 5.0  # [-], relaxation length of the wave over the contact length before any is known
LENGTH_RANGE = (2.0, 40.0)  # [-], relaxation length over the contact length
MIN_CROSSING = 0.2  # [-], least relaxation length between waves that grow and decay, over the last length
MIN_MODE = 0.02  # [-], least change of the wave between two settled states that define a mode, over the wave
MIN_WAVE = 0.1  # [-], least area of a wave over depth and contact length whose mode counts; lower ones are scatter
SIGNIFICANCE = 3.0  # [-], standard errors from which a change of the wave counts
WAVE_EXPONENT = 3.4  # [-], of the area of the wave over the depth, roughly
SAME_DEPTH = 1e-3  # [-], relative change of the depth below which settled states belong to one depth
MIN_RESISTANCE = 3e-2  # [-], least scale of the resistance over the load; that of a driven roller may vanish
STRETCHED_DEPTH = 1.25  # [-], ratio of a depth to that of the mesh from which the mesh is stretched
MIN_ERROR_SCALE = 1e-3  # [-], least scale of the error of the resistance over the load
DEPTH_EXPONENTS = np.array([1.2, 2.3, 1.0, 0.6])  # [-], of `QUANTITIES` over the depth; of the density: its increase
ORDERS = np.array([1.0, 1.5])  # [-], of load and resistance in the element length
WAVE_SHARE = 0.5  # [-], of the change of a force by that of the wave, the least change between two meshes

Stretch = Callable[[IncrementalRolling, float], IncrementalRolling]


@dataclass(frozen=True, eq=False)
class SteadyErrors:
    """Estimated distance of a state from the steady state, in the units of `QUANTITIES`.

    Parameters
    ----------
    drift : ndarray, shape (4,)
        Distance along the slow mode.
    start : ndarray, shape (4,)
        Scatter of the drift, and the transient of the start.
    load, resistance : float
        Scales of load and resistance [N/m].
    """

    drift: FloatArray
    start: FloatArray
    load: float
    resistance: float

    @property
    def total(self) -> float:
        """Largest sum of both of load and resistance over their scales, and of the exit density ratio [-]."""
        return float(((self.drift + self.start)[:3] / [self.load, self.resistance, 1.0]).max())


@dataclass
class WaveGrowth:
    """Successive jumps by which a wave should grow by more than `GROWTH`.

    Attributes
    ----------
    slopes : list of float
        Growth of the wave over the travel before each of these jumps [m].
    """

    slopes: list[float] = field(default_factory=list)

    def record(self, drift: WaveDrift, jump: float) -> None:
        """Record the drift of a cycle and the jump to the steady wave [m2]."""
        self.slopes = [*self.slopes, drift.wave_slope] if jump > GROWTH * drift.wave_area else []

    @property
    def is_unslowed(self) -> bool:
        """True if the wave grows as fast as before the first jump, although it is much larger."""
        return len(self.slopes) > 1 and self.slopes[-1] > SLOWING * self.slopes[0]

    @property
    def is_endless(self) -> bool:
        """True if the wave has no steady state."""
        return len(self.slopes) > MAX_GROWTHS or (len(self.slopes) > MAX_UNSLOWED and self.is_unslowed)


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
    stretch: Stretch
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
        mode = coarse.relaxation.mode
        first = coarse.relaxation.first_length
        self.relaxation = Relaxation(first, None if mode is None else mode.on_mesh(old, new), first)
        self.finds_length = self.relaxation.length is None
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
                raise heaping_error(self.rolling, "grows without slowing down until a step fails") from error
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
                raise heaping_error(self.rolling, "grows without a steady state")
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

    def _steps_of(self, share: float) -> int:
        """Return the number of steps in a share of the contact length, or of a third of a much higher layer."""
        frame = self.rolling.frame
        length = max(frame.contact_length, HEIGHT_SHARE * frame.mesh.height)
        return max(int(np.ceil(share * length / frame.step)), MIN_STEPS)

    def _roll(self, share: float, damping: float = FINAL_DAMPING_RATIO * DAMPING) -> None:
        """Roll a share of the contact length at the present depth, which the first half of the steps approaches."""
        rolling, count = self.rolling, self._steps_of(share)
        start = rolling.steps[-1].bottom_height if rolling.steps else rolling.frame.mesh.height
        approach = np.linspace(start, self._height, 1 + (2 * count if not rolling.steps else max(count // 2, 1)))[1:]
        for height in [*approach, *[self._height] * max(count - len(approach), count // 2)]:
            rolling.advance(float(height), damping)
        require_low_wave(rolling)

    def _measure(self, share: float) -> WaveDrift:
        """Roll on, fit the drift, and update relaxation length and mode from the settled states."""
        begin, count = copy(self.rolling), self._steps_of(share)
        self._roll(share)
        drift = WaveDrift.of_steps(self.rolling.steps[-count - 1 :])
        first, before = (begin, None) if self._settled is None else (self._settled, self._drifts[-1])
        self._drifts.append(drift)
        self._update_length()
        self._update_mode(first, before, drift)
        self._settled = copy(self.rolling)
        return drift

    def _update_length(self) -> None:
        """Fit the relaxation length, or on a finer mesh shorten it where two waves bracket the steady one."""
        known = self.relaxation.length
        if self.finds_length:
            found = relaxation_length(self._drifts)
            bounds = np.multiply(LENGTH_RANGE, self.rolling.frame.contact_length)
        else:
            assert known is not None  # otherwise this mesh finds it
            found, bounds = crossing_length(self._drifts), np.array([MIN_CROSSING * known, known])
        if found is not None:
            length = float(np.clip(found, *bounds))
            first = length if self.finds_length else self.relaxation.first_length
            self.relaxation = replace(self.relaxation, length=length, first_length=first)

    def _update_mode(self, first: IncrementalRolling, before: WaveDrift | None, drift: WaveDrift) -> None:
        """Take the difference of two settled states of one depth as mode if the wave has changed beyond its scatter."""
        is_low = drift.wave_area < MIN_WAVE * self.depth * self.rolling.frame.contact_length
        if is_low or (before is None and self.relaxation.mode is not None):
            return
        change = self.rolling.steps[-1].wave_area - first.steps[-1].wave_area
        if abs(change) < max(MIN_MODE * drift.wave_area, SIGNIFICANCE * drift.wave_error * drift.travel):
            return
        if before is None:
            slopes = drift.slopes / drift.wave_slope
        else:
            slopes = (drift.values - before.values) / (drift.wave_area - before.wave_area)
        self.relaxation = replace(self.relaxation, mode=BowWaveMode.between(first, self.rolling, slopes))

    def _estimate(self, drift: WaveDrift) -> float:
        """Estimate steady values and errors; return the distance of the area of the wave to its steady value [m2]."""
        contact_length = self.rolling.frame.contact_length
        known = self.relaxation
        length = FIRST_LENGTH * contact_length if known.length is None else known.length
        slopes = np.zeros(len(QUANTITIES)) if known.mode is None else known.mode.slopes
        jump, scatter = length * drift.wave_slope, length * drift.wave_error
        if abs(drift.wave_slope) < SIGNIFICANCE * drift.wave_error:
            jump = 0.0
        load, resistance = np.abs(drift.values[:2])
        self.values = drift.values + slopes * jump
        transient = max(contact_length, HEIGHT_SHARE * self.rolling.frame.mesh.height) * np.abs(
            drift.slopes - slopes * drift.wave_slope
        )
        drifted, start = LENGTH_ERROR * np.abs(slopes * jump), np.abs(slopes) * scatter + transient
        self.errors = SteadyErrors(drifted, start, float(load), float(max(resistance, MIN_RESISTANCE * load)))
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
        passed = rolling.steps[-min(int(rolling.frame.exit_distance / rolling.frame.step) + 1, len(rolling.steps))]
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
            stretching = depth / self.rolling.mesh_depth
            if max(stretching, 1 / stretching) > STRETCHED_DEPTH:
                self.rolling = self.stretch(self.rolling, depth)
            if self.rate_factor is not None:
                self.rolling.frame.solid.rate_factor = self.rate_factor(depth)
            try:
                return self._roll(share)
            except RuntimeError:
                if not trial:
                    raise

    def _unsteady_error(self) -> UnsteadyError:
        """Return the error of a motion that does not become steady."""
        step = self.rolling.steps[-1]
        distance = self.errors.total
        unsteady = Unsteady(self.depth, step.bow_wave, step.travel, distance, step.load, step.resistance)
        message = (
            f"not steady at depth {1e3 * self.depth:.4g} mm after {step.travel:.3g} m of travel: estimated distance "
            f"{100 * distance:.2g} % of load, resistance or exit density; {describe_step(step)}"
        )
        return UnsteadyError(message, unsteady)


@dataclass(frozen=True)
class ErrorParts:
    """Estimated relative errors of load and resistance [-], pairs.

    Parameters
    ----------
    mesh : tuple of float, or None
        Error of the finite elements; None for a single mesh.
    drift : tuple of float
        Distance to the steady state.
    start : tuple of float
        Scatter and transient.
    """

    mesh: tuple[float, float] | None
    drift: tuple[float, float]
    start: tuple[float, float]

    @property
    def total(self) -> tuple[float, float] | None:
        """Sums of the parts for load and resistance [-]; None without an estimate of the mesh."""
        if self.mesh is None:
            return None
        load, resistance = np.sum([self.mesh, self.drift, self.start], axis=0)
        return float(load), float(resistance)


def error_parts(search: SteadySearch, mesh: tuple[float, float] | None) -> ErrorParts:
    """Return the errors of a steady solution.

    Parameters
    ----------
    search : SteadySearch
        Search that has found the steady state.
    mesh : tuple of float, or None
        Relative errors of load and resistance by the mesh [-].
    """
    drift, start = (_at_target(part, search) for part in (search.errors.drift, search.errors.start))
    return ErrorParts(mesh, drift, start)


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
    remaining = 1 / ((elements[1] / elements[0]) ** orders - 1)
    change = np.abs(_at_same_target(coarse, fine) - fine.values)
    mode = fine.relaxation.mode
    if mode is not None and fine.target.quantity == "indentation":
        wave = fine.rolling.steps[-1].wave_area - coarse.rolling.steps[-1].wave_area
        change = np.maximum(change, WAVE_SHARE * np.abs(mode.slopes * wave))
    return np.asarray(remaining * change[:2] / _scales(fine))


def _at_same_target(coarse: SteadySearch, fine: SteadySearch) -> FloatArray:
    """Return the values of a coarse solution at the prescribed value of the fine one; targets are met loosely."""
    quantity, values = fine.target.quantity, coarse.values
    if quantity == "indentation":
        return values
    if quantity == "exit_density_ratio":  # prescribes the depth; the density of a column lags behind it
        return values * (fine.depth / coarse.depth) ** DEPTH_EXPONENTS
    index = QUANTITIES.index(quantity)
    miss = coarse.target.log_miss(float(values[index])) - fine.target.log_miss(float(fine.values[index]))
    return values * np.exp(-miss * DEPTH_EXPONENTS / DEPTH_EXPONENTS[index])


def _at_target(errors: FloatArray, search: SteadySearch) -> tuple[float, float]:
    """Return the errors of load and resistance at what is prescribed."""
    load, resistance = (float(error) for error in errors[:2] / _scales(search))
    if search.target.quantity != "load":
        return load, resistance
    return 0.0, resistance + float(DEPTH_EXPONENTS[1] / DEPTH_EXPONENTS[0]) * load


def _scales(search: SteadySearch) -> FloatArray:
    """Return load and resistance, the latter not too small, as scales of their errors [N/m], shape (2,)."""
    load, resistance = np.abs(search.values[:2])
    return np.array([load, max(resistance, MIN_ERROR_SCALE * load)])
