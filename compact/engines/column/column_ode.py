"""Confined compression of stacked columns of compacting mix, integrated over the gap under a roller.

A column has no lateral strain. Its stress state is the mean stress p and the deviator D = s_v - s_h; stacked columns
share the vertical stress s_v = p + 2D/3. Compression is positive; V is the plastic volume strain. On the yield surface
of `cap_plasticity` with the outward normal (P, Q) = (df/dp, df/dD)/2, half length a and centre c of the cap, and with
pc = pc(k), u = u(k), H = dpc/dV, U = du/dV,

    dp = K (de - dV),  dD = 3G (2de/3 - Q w),  dV = P w,  P dp + Q dD = h w,  h = [P (H/2 + U) + a H/2] P,

where de is the strain of the column and w >= 0 the plastic multiplier. Per unit of s_v, with b = P - 3Q/2 and
g = 3/2 + 2G/K,

    dp/ds_v = (3/2)(h - 2G b Q)/B,   w/ds_v = (3/2)(P + 2G Q/K)/B,   B = g h + 2G b^2,

and dp/ds_v = 3/(2g) inside the yield surface. On the shear line D = +-M (p + pt) of `drucker_prager_cap` in its place

    dp/ds_v = 1/(1 +- 2M/3),   w/ds_v = (2G/K dp/ds_v - dD/ds_v)/(+-3G + 2G N),   dV = -N w,

without its viscosity, since columns have no bands of shear. The heights h_i of the columns add up to the gap under the
roller, so that ds_v = -dgap/sum (de/ds_v) h_i. The slope of the gap under a circle is unbounded at its upright side.
The path is therefore integrated over the tangent t of half the central angle, u = 2 R t:

    q = 1/(1 + c u^2/(4 R^2)),   x = u q,   gap = u^2 q/(2R),   dx/du = q (2q - 1),   dgap/du = u q^2/R,

c = 1 for the circle, which is upright at u = 2R, and c = 0 for the parabola, where u = x. Work and forces are
integrated together with the stress by the Dormand-Prince method of order 8. Events end a step: first yield of each
column, the end of the unloading, and each change of its rates: onset of hardening, saturation limit, from one part of
the yield surface to the next. Within a step the rates keep their form beyond an event, so that it is smooth.

The model neglects shear and lateral flow, so that it is accurate to second order in height over contact length.

References
----------
E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, Springer 1993, II.5, II.10.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.integrate import DOP853

from compact.material.elliptic_cap import CapConstants, hardening, heckel_curve, reaction
from compact.numerics import Array, IntArray
from compact.numerics.jit import compiled, inlined

STAGES, ORDER = 12, 8  # [-], of the Dormand-Prince method
A, C = np.vstack([DOP853.A, DOP853.B]), np.append(DOP853.C, 1.0)  # [-], Butcher tableau; last row: the step itself
E3, E5 = DOP853.E3.copy(), DOP853.E5.copy()  # [-], weights of the embedded error estimates
INITIAL_STEP_SHARE = 1 / 64  # [-], first step over the length of the path
STEPS_MAX = 40_000  # [-], steps tried; 50 are usual, a mix 1000 times stiffer to unload needs 1000 times as many
STEP_SAFETY = 0.9  # [-], factor on the step that the error estimate allows
STEP_FACTOR_MIN, STEP_FACTOR_MAX = 0.2, 10.0  # [-], bounds of the change from one step to the next
EVENT_ITERATIONS_MAX = 60  # [-], of regula falsi on one step; 5 are usual
EVENT_TOLERANCE = 1e-4  # [-], residual of the stress at an event over the error scale of s_v
CORNER_SIDE = 1 - 1e-12  # [-], p + pt over that of the corner, below which mix is on the shear line
STRAIN_ROUNDING = 1e-15  # [-], of k and thus of V at an event; K_s times it is that of the reaction
EVENT_ROUNDING = 1e-14  # [-], smallest residual at an event over s_v itself

# Indices of the state vector y; from COLUMN_STATE on, p and V of each column
STRESS, LOAD_INTEGRAL, RESISTANCE_INTEGRAL, PLASTIC_WORK, ELASTIC_WORK, COLUMN_STATE = range(6)
# Regimes of a column, in which one step stays: elastic, sliding on the shear line, or yielding without hardening below
# the largest density ratio, on Heckel's curve, as saturated mix
ELASTIC, LINE, NONE, HECKEL, SATURATED = range(5)
# Status codes of `integrate_path`
REACHED, PAUSED, STEPS_EXHAUSTED, STEP_UNDERFLOW, EVENT_NOT_LOCATED = range(5)
# Indices of `IntegrationState.counts`: last row of the path, evaluations of the rates, steps tried
ROW, EVALUATIONS, STEPS_TRIED = range(3)


class ColumnStack(NamedTuple):
    """Columns on top of one another at rest, arrays of shape (n,) from the base upwards.

    Attributes
    ----------
    height : ndarray
        Heights [m].
    density_ratio : ndarray
        Density ratios k [-].
    mean_stress : ndarray
        Mean stresses p [Pa].
    max_density_ratio : ndarray
        Largest density ratios reached [-], which fix pc on the flat yield surface; 0 for k itself.
    """

    height: Array
    density_ratio: Array
    mean_stress: Array
    max_density_ratio: Array


class GapShape(NamedTuple):
    """Shape gap(x) of the roller, x from its lowest generatrix.

    Attributes
    ----------
    radius : float
        Roller radius R [m]; 0 for a plate, under which the gap is u.
    circular : float
        Coefficient c [-]: 1 for the circle, 0 for the parabola.
    """

    radius: float
    circular: float

    def at(self, x: Array) -> Array:
        """Return the gap of a roller [m] at x [m]."""
        R = self.radius
        return x**2 / (R + np.sqrt(R**2 - x**2) if self.circular else 2 * R)

    def edge(self, depth: float) -> float:
        """Return x [m] at which the gap has risen by `depth` [m] above the lowest generatrix."""
        R, c = self
        return math.sqrt(depth * (2 * R - c * depth)) if R else depth

    def front(self, depth: float) -> float:
        """Return the coordinate u [m] at which the gap has risen by `depth` [m]."""
        R, c = self
        return 2 * R * math.sqrt(depth / (2 * R - c * depth)) if R else depth

    def positions(self, u: Array) -> Array:
        """Return x [m] of coordinates u [m]."""
        R, c = self
        return u / (1 + c * (u / (2 * R)) ** 2) if R else u


# material constants at the rolling speed, columns before the pass, shape of the roller, True for logarithmic strain
ColumnProblem = tuple[CapConstants, ColumnStack, GapShape, bool]


class PathControl(NamedTuple):
    """End of a path and accuracy of its integration.

    Attributes
    ----------
    coordinate_end : float
        Coordinate u at which the path ends [m].
    stress_end : float
        Vertical stress at which it ends earlier [Pa].
    error_scale : ndarray
        Error of each component of y allowed in one step, in its unit.
    max_step : float
        Largest step over u [m].
    """

    coordinate_end: float
    stress_end: float
    error_scale: Array
    max_step: float


class IntegrationState(NamedTuple):
    """Progress of an integration between two calls of `integrate_path`, modified in place.

    Attributes
    ----------
    max_density_ratio : ndarray
        Largest density ratio reached by each column [-].
    regime : ndarray
        Regime of each column, see ELASTIC, LINE, NONE, HECKEL, SATURATED.
    event_stress : ndarray
        Vertical stress at which each column changes its regime next [Pa].
    step : ndarray
        Next step over u [m], shape (1,); 0 at the start.
    counts : ndarray
        See ROW, EVALUATIONS, STEPS_TRIED.
    """

    max_density_ratio: Array
    regime: IntArray
    event_stress: Array
    step: Array
    counts: IntArray


@compiled
def integrate_path(problem: ColumnProblem, control: PathControl, state: IntegrationState, path: Array) -> int:
    """Integrate the columns from the last row of a path until its end.

    Parameters
    ----------
    path : ndarray
        Rows (u, y), one for each step, the last at `state.counts[ROW]`; new rows are written behind it. The vector y
        is (s_v, int s_v dx, int s_v gap' dx, plastic work, elastic work, p_1, V_1, ...) in SI units. V counts from the
        stack.

    Returns
    -------
    int
        Status. PAUSED when the path is full: the same call continues with a longer one. REACHED at the end.
        STEPS_EXHAUSTED after STEPS_MAX steps. STEP_UNDERFLOW if a step does not change u. EVENT_NOT_LOCATED if the
        stress of an event is not found.

    Notes
    -----
    The return value is a bare number: boxing an array executes Python code, in which a keyboard interrupt gets lost.
    """
    law, stack, _, _ = problem
    counts, event_stress, n = state.counts, state.event_stress, len(stack.height)
    u, y, u_end = path[counts[ROW], 0], path[counts[ROW], 1:].copy(), control.coordinate_end
    z, K = np.empty(len(y)), np.empty((STAGES + 1, len(y)))
    stages = y, z, K
    direction = 1.0 if control.stress_end > y[STRESS] else -1.0
    # an event closer to the end than the tolerance is ignored: at rest, mix without strength is on its yield surface
    slack = max(EVENT_TOLERANCE * control.error_scale[STRESS], EVENT_ROUNDING * abs(path[0, 1 + STRESS]))
    end, step = control.stress_end - direction * slack, state.step[0]
    if step == 0:
        step = (u_end - u) * INITIAL_STEP_SHARE
        for i in range(n):
            event_stress[i] = yield_stress(law, _event_state(stack, y, i), direction)
    _rates(u, y, K[0], problem, state)
    while u != u_end:
        i = int(np.argmin(direction * event_stress))
        is_event = direction * (end - event_stress[i]) > 0
        stop = event_stress[i] if is_event else control.stress_end
        if direction * (stop - y[STRESS]) <= 0:
            if not is_event:
                return REACHED
            _change_regime(law, stack, y, i, direction, state)
            _rates(u, y, K[0], problem, state)
            step = (u_end - u) * INITIAL_STEP_SHARE
            continue
        if counts[STEPS_TRIED] >= STEPS_MAX:
            return STEPS_EXHAUSTED
        if counts[ROW] + 1 == len(path):
            state.step[0] = step
            return PAUSED
        counts[STEPS_TRIED] += 1
        step = np.sign(u_end - u) * min(abs(step), abs(u_end - u), control.max_step)
        if u + step == u:
            return STEP_UNDERFLOW
        error, kinked = _runge_kutta_step(u, step, stages, problem, state, control.error_scale), False
        if error <= 1:
            located, step, kinked = _end_step(u, step, stages, problem, state, control, stop)
            if not located:
                return EVENT_NOT_LOCATED
            u = u_end if step == u_end - u else u + step
            counts[ROW] += 1
            path[counts[ROW], 0] = u
            for m in range(len(y)):  # assignments of arrays take seconds to compile
                y[m] = path[counts[ROW], 1 + m] = z[m]
                K[0, m] = K[STAGES, m]
        step *= min(STEP_FACTOR_MAX, max(STEP_FACTOR_MIN, STEP_SAFETY * max(error, 1e-20) ** (-1 / ORDER)))
        if kinked:
            step = (u_end - u) * INITIAL_STEP_SHARE
    return REACHED


@compiled
def _change_regime(law, stack, y, i, direction, state):
    """Let column i yield, or cross from one part of its yield surface to the next at its event."""
    point, slides, subcritical = _event_state(stack, y, i), False, direction < 0
    if state.regime[i] <= LINE:
        inside_corner = law.line and point[1] + law.pt <= _corner_pressure(law, point[2]) * CORNER_SIDE
        slides = state.regime[i] == ELASTIC and inside_corner
        state.event_stress[i] = critical_stress(law, point, direction, slides)
        subcritical = point[1] <= _yield_surface(law, point[2])[1]
    else:
        state.event_stress[i] = direction * np.inf
    k, V = stack.density_ratio[i], y[COLUMN_STATE + 2 * i + 1]
    if slides:
        state.regime[i] = LINE
    elif law.flat and (subcritical or np.log(state.max_density_ratio[i] / k) > V):
        state.regime[i] = NONE
    else:
        state.regime[i] = HECKEL if np.log(law.limit / k) > V else SATURATED


@compiled
def _runge_kutta_step(u, step, stages, problem, state, error_scale):
    """Compute one Dormand-Prince step from y to z by the rates K of its stages; return its error over `error_scale`."""
    y, z, K = stages
    state.counts[EVALUATIONS] += STAGES
    for stage in range(1, STAGES + 1):
        for m in range(len(y)):
            slope = 0.0
            for earlier in range(stage):
                slope += A[stage, earlier] * K[earlier, m]
            z[m] = y[m] + step * slope
        _rates(u + C[stage] * step, z, K[stage], problem, state)
    third, fifth = 0.0, 0.0
    for m in range(len(y)):
        third_m, fifth_m = 0.0, 0.0
        for stage in range(STAGES + 1):
            third_m += E3[stage] * K[stage, m]
            fifth_m += E5[stage] * K[stage, m]
        third += (third_m / error_scale[m]) ** 2
        fifth += (fifth_m / error_scale[m]) ** 2
    if fifth == 0:
        return 0.0
    error = abs(step) * fifth / np.sqrt((fifth + 0.01 * third) * len(y))
    return error if error >= 0 else np.inf  # not a number if the step is far too long


@compiled
def _end_step(u, step, stages, problem, state, control, stop):
    """End a step at the first event within it; return success, the step, and whether the rates have a kink there.

    The events are the vertical stress `stop`; the density ratio of a column that reaches the saturation limit or its
    largest one; unloading columns that pass from the cap to the flat part, or from either to the shear line.
    """
    y, z, K = stages
    (law, stack, _, _), n, last, located = problem, len(state.regime), -1, True
    if (z[STRESS] - stop) * (y[STRESS] - stop) <= 0:
        located, step = _locate_event(u, step, stages, problem, state, control.error_scale, (-1, stop))
        z[STRESS] = stop
    for event in range(3 * n):
        goal = event, _threshold(problem, state, y, event, control.stress_end)
        if _distance(problem, state, y, goal) < 0 <= _distance(problem, state, z, goal):
            found, step = _locate_event(u, step, stages, problem, state, control.error_scale, goal)
            located, last = located and found, event
    for event in range(3 * n if last >= 0 else 0):  # columns may be alike
        goal = event, _threshold(problem, state, y, event, control.stress_end)
        if event == last or _distance(problem, state, y, goal) < 0 <= _distance(problem, state, z, goal):
            _pass_event(problem, state, z, event)
    for j in range(n if law.flat else 0):
        k = stack.density_ratio[j] * np.exp(z[COLUMN_STATE + 2 * j + 1])
        state.max_density_ratio[j] = max(state.max_density_ratio[j], k)
    if last >= 0:
        _rates(u + step, z, K[STAGES], problem, state)
    return located, step, last >= 0


@compiled
def _pass_event(problem, state, z, event):
    """Change the regime of a column at an event of `_end_step`."""
    law, stack, _, _ = problem
    n = len(state.regime)
    i = event % n
    if event >= 2 * n:
        state.regime[i] = NONE
        state.event_stress[i] = critical_stress(law, _event_state(stack, z, i), -1.0, False)
    elif event >= n:
        state.regime[i] = LINE
    elif state.regime[i] == SATURATED or (state.regime[i] == NONE and state.max_density_ratio[i] < law.limit):
        state.regime[i] = HECKEL
    else:
        state.regime[i] = SATURATED


@compiled
def _threshold(problem, state, y, event, stress_end):
    """Return the plastic volume strain at which an event happens, 0 for those of the pressure, or NaN for none."""
    law, stack, _, _ = problem
    n = len(state.regime)
    i = event % n
    regime, unloads = state.regime[i], stress_end < y[STRESS]
    if regime <= LINE:
        return np.nan
    if event < n:
        k = state.max_density_ratio[i] if regime == NONE else law.limit
        return np.nan if law.flat and regime == SATURATED else np.log(k / stack.density_ratio[i])
    happens = law.flat and regime != NONE if event >= 2 * n else law.line and y[STRESS] < y[COLUMN_STATE + 2 * i]
    return 0.0 if unloads and happens else np.nan


@compiled
def _distance(problem, state, y, goal):
    """Return how far a state is beyond a threshold of `_threshold`, or the vertical stress beyond it (event -1)."""
    event, threshold = goal
    law, stack, _, _ = problem
    n = len(state.regime)
    i = event % n
    if event < 0:
        return y[STRESS] - threshold
    if event < n:
        rise = y[COLUMN_STATE + 2 * i + 1] - threshold
        return -rise if state.regime[i] == SATURATED else rise
    k = max(_event_state(stack, y, i)[2], state.max_density_ratio[i])
    end = _yield_surface(law, k)[1] if event >= 2 * n else _corner_pressure(law, k) * CORNER_SIDE - law.pt
    return threshold + end - y[COLUMN_STATE + 2 * i]


@compiled
def _locate_event(u, step, stages, problem, state, error_scale, goal):
    """Shorten a step by regula falsi (Illinois) so that it ends at an event; return success and the step."""
    y, z, _ = stages
    event, value = goal
    low, high, below, above = 0.0, step, _distance(problem, state, y, goal), _distance(problem, state, z, goal)
    scale, rounding = error_scale[STRESS], EVENT_ROUNDING * max(abs(value), abs(y[STRESS]))
    if 0 <= event < len(state.regime):
        scale, rounding = error_scale[COLUMN_STATE + 1], STRAIN_ROUNDING
    elif (state.regime == SATURATED).any():
        rounding += STRAIN_ROUNDING * problem[0].saturation
    tolerance = max(EVENT_TOLERANCE * scale, rounding)
    for _ in range(EVENT_ITERATIONS_MAX + 1):
        if abs(above) <= tolerance or low == high:
            return True, high
        trial = high - above * (high - low) / (above - below)
        _runge_kutta_step(u, trial, stages, problem, state, error_scale)
        residual = _distance(problem, state, z, goal)
        if residual * above < 0:
            low, below = high, above
        else:
            below /= 2
        high, above = trial, residual
    return abs(above) <= scale, high


@compiled
def _rates(u, y, out, problem, state):
    """Write dy/du to `out`."""
    law, stack, gap, logarithmic = problem
    stress, plastic, elastic, compliance = y[STRESS], 0.0, 0.0, 0.0
    for i in range(len(stack.height)):
        p, V = y[COLUMN_STATE + 2 * i], y[COLUMN_STATE + 2 * i + 1]
        dp, dV, dshear = 1 / (1 + 4 * law.G / law.K / 3), 0.0, 0.0
        if state.regime[i] != ELASTIC:
            k = state.max_density_ratio[i]
            if state.regime[i] != NONE:
                k = max(k, stack.density_ratio[i] * np.exp(V))
            dp, dV, dshear = _stress_rates(law, (stress, p, k), state.regime[i])
        height, D = stack.height[i], 1.5 * (stress - p)
        if logarithmic:
            height *= np.exp(-(V + (p - stack.mean_stress[i]) / law.K))
        compliance += height * (dp / law.K + dV)
        plastic += height * (p * dV + D * dshear)
        elastic += height * (p * dp / law.K + D * (1 - dp) / (2 * law.G))
        out[COLUMN_STATE + 2 * i], out[COLUMN_STATE + 2 * i + 1] = dp, dV
    dx, dgap = 1.0, 1.0  # dx/du, dgap/du
    if gap.radius > 0:
        t = u / gap.radius
        q = 1 / (1 + gap.circular * t * t / 4)
        dx, dgap = q * (2 * q - 1), t * q * q
    rate = -dgap / compliance
    out[STRESS], out[LOAD_INTEGRAL], out[RESISTANCE_INTEGRAL] = rate, stress * dx, stress * dgap
    out[PLASTIC_WORK], out[ELASTIC_WORK] = plastic * rate, elastic * rate
    for m in range(COLUMN_STATE, len(y)):
        out[m] *= rate


@inlined
def _stress_rates(law, point, regime):
    """Return dp, dV and the plastic shear strain Q w per unit of s_v of a column that yields, in the symbols above.

    `point` as of `yield_stress`. The curves of a regime go on beyond its ends, so that a step past an end is smooth.
    """
    stress, p, k = point
    ratio, g = 2 * law.G / law.K, 1.5 + 2 * law.G / law.K
    if regime == LINE:
        sign = 1.0 if stress > p else -1.0
        dp = 1 / (1 + sign * law.friction / 1.5)
        w = (ratio * dp - 1.5 * (1 - dp)) / (law.G * (3 * sign + 2 * law.dilatancy))
        return dp, -law.dilatancy * w, sign * w
    pc, u, H, U = hardening(law, k)[0], reaction(law, k)[0], 0.0, 0.0
    if regime == HECKEL:
        (pc, H), u = heckel_curve(law, k), 0.0
    elif regime == SATURATED:
        pc, u, U = hardening(law, law.limit)[0], law.saturation * np.log(k / law.limit), law.saturation
    a, c = (pc + law.pt) / 2, (pc - law.pt) / 2 + u
    P, Q, p0 = p - c, 1.5 * (stress - p) / law.M**2, min(c, 0.0) if law.flat else c
    rise = P * (H / 2 + U) + a * H / 2
    if law.flat and p <= c:  # the mix does not harden
        P, rise = min(p - p0, 0.0), 0.0
        if law.line:  # the top of the cap
            P = 0.0
        elif p0 > -law.pt:
            P *= (a / (p0 + law.pt)) ** 2
        elif p <= p0:  # no strength: tension cut-off
            P, Q = -1.0, 0.0
    h, b = rise * P, P - 1.5 * Q
    w = 1.5 / (g * h + 2 * law.G * b * b)
    return w * (h - 2 * law.G * b * Q), w * (P + ratio * Q) * P, w * (P + ratio * Q) * Q


@compiled
def _yield_surface(law, k):
    """Half the length a of the yield surface, its critical pressure c, and the largest p of its curved tensile part."""
    pc, _ = hardening(law, k)
    u, _ = reaction(law, k)
    c = (pc - law.pt) / 2 + u
    return (pc + law.pt) / 2, c, min(c, 0.0) if law.flat else c


@compiled
def _corner_pressure(law, k):
    """Return p + pt at the corner of cap and shear line, or of the line and the top of a cap that it misses."""
    a, c, _ = _yield_surface(law, k)
    b, square = c + law.pt, 1 + (law.friction / law.M) ** 2
    rest = b * b - square * (b * b - a * a)
    return (b + np.sqrt(rest)) / square if rest >= 0 else law.M * a / law.friction


@compiled
def _event_state(stack, y, i):
    """Return s_v, p and the density ratio of the yield surface of column i."""
    k = stack.density_ratio[i] * np.exp(y[COLUMN_STATE + 2 * i + 1])
    return y[STRESS], y[COLUMN_STATE + 2 * i], max(k, stack.max_density_ratio[i])


@compiled
def yield_stress(law: CapConstants, point: tuple, direction: float) -> float:
    """Vertical stress at which a column yields in loading (direction 1) or unloading (-1).

    `point` contains s_v and p [Pa], and the density ratio of the yield surface [-].
    """
    stress, p, k = point
    a, c, p0 = _yield_surface(law, k)
    oedometric = law.K + 4 * law.G / 3
    D, dp, dD = 1.5 * (stress - p), direction * law.K / oedometric, direction * 2 * law.G / oedometric
    cap = _ellipse_crossing(p - c, D / law.M, 1.0, dp, dD / law.M, a)
    if law.line:  # the elastic range is the intersection of the cap and both lines
        if p + cap * dp < c:
            cap = _ellipse_crossing(0.0, D / law.M, 0.0, dp, dD / law.M, a)
        for sign in (1.0, -1.0):
            distance, approach = law.friction * (p + law.pt) - sign * D, sign * dD - law.friction * dp
            if approach > 0:
                cap = min(cap, max(distance / approach, 0.0))
        return stress + direction * cap
    if not law.flat or p + cap * dp >= c:
        return stress + direction * cap
    if p0 > -law.pt:
        tensile = _ellipse_crossing(p - p0, D / law.M, (a / (p0 + law.pt)) ** 2, dp, dD / law.M, a)
        if p + tensile * dp <= p0:
            return stress + direction * tensile
    elif direction < 0:
        cutoff = max((p0 - p) / dp, 0.0)
        if abs(D + cutoff * dD) <= law.M * a:
            return stress + direction * cutoff
    return stress + direction * _ellipse_crossing(0.0, D / law.M, 0.0, dp, dD / law.M, a)


@compiled
def critical_stress(law: CapConstants, point: tuple, direction: float, on_line: bool) -> float:
    """Vertical stress at which a column leaves the flat part of its yield surface or loading the shear line.

    Loading leaves the flat part for the cap, and unloading for the tensile part.
    """
    stress, p, k = point
    _, c, p0 = _yield_surface(law, k)
    if on_line:
        distance = _corner_pressure(law, k) - (p + law.pt)
        rises = direction > 0 and stress > p and distance > 0
        return stress + distance * (1 + law.friction / 1.5) if rises else direction * np.inf
    if law.flat and direction > 0 and p < c:
        return stress + c - p
    return stress + p0 - p if law.flat and not law.line and direction < 0 and p0 < p < c else direction * np.inf


@compiled
def _ellipse_crossing(y, z, r, dy, dz, a):
    """Largest t >= 0 at which r (y + t dy)^2 + (z + t dz)^2 = a^2."""
    square, half, rest = r * dy * dy + dz * dz, r * y * dy + z * dz, r * y * y + z * z - a * a
    return max(0.0, (np.sqrt(max(half * half - square * rest, 0.0)) - half) / square)
