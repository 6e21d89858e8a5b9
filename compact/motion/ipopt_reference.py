"""A second opinion on optimal laws: the same program by IPOPT, from any start (casadi, the extra `optimise`).

Nothing of the steps, tangents and trust regions of `optimise` is used: IPOPT sees the criterion itself, with its exact
derivatives, the linear limits, and the curvature of a roller's cam. The resistance enters by a cubic spline through its
values over the speed and, where it depends on it, the acceleration; peaks and positive parts by unknowns above them.
"""

import numpy as np
from scipy import sparse

from compact.motion.limits import MARGIN
from compact.motion.objectives import PEAKS
from compact.numerics.convex_programs import minimise_linear

SAMPLES, FEWER, SHARES = 400, 120, 41  # of the resistance over the speed; over both where the acceleration counts
FASTEST = 4.0  # times the mean speed, up to which a resistance without a limit of speed is asked
WIDE = 0.999  # up to which the share u = a/(a^2 + A^2)^(1/2) is asked; A is twice the mean speed over the duration
SAME = 1e-12  # relative: a resistance that differs by less at another acceleration does not depend on it
AGAIN = 3  # starts, after that of a search
CORNERS = 6  # of the set of laws, of which a start is a mean
SETTINGS = {"ipopt.print_level": 0, "print_time": 0, "ipopt.sb": "yes", "ipopt.max_iter": 2000, "ipopt.tol": 1e-8}


def casadi():
    """The package, or a refusal in words."""
    try:
        import casadi
    except ImportError:
        raise RuntimeError("this needs casadi, which is not installed; pip install '.[optimise]'") from None
    return casadi


def starts(task, count, seed=0):
    """Unknowns of laws all over what the limits leave, shape (count, unknowns): means of random corners."""
    random, size = np.random.default_rng(seed), task.held.space.size
    found = []
    for _ in range(count):
        corners = [minimise_linear(random.normal(size=size), task.held.program) for _ in range(CORNERS)]
        found.append(random.dirichlet(np.ones(CORNERS)) @ corners)
    return np.array(found)


def best(task, count, seed=0):
    """(least criterion, all that were reached, rising) of a `sequential_programming.Task` by IPOPT from so many starts.

    Raises RuntimeError without casadi, and where no start leads to a law.
    """
    program = _Program(task)
    reached = [found[1] for found in map(program.solved, starts(task, count, seed)) if found]
    if not reached:
        raise RuntimeError(f"IPOPT reached a law from none of {count} starts")
    return min(reached), np.sort(reached)


def descent(task, unknowns):
    """(unknowns, J, iterations) by IPOPT from a law within the limits.

    Raises RuntimeError without casadi, and where IPOPT gives up.
    """
    program, again = _Program(task), starts(task, AGAIN)
    for start in (unknowns, *again):
        if found := program.solved(start):
            return found
    raise RuntimeError(f"IPOPT reached no law from {1 + AGAIN} starts; leave `method` to the steps of compact")


class _Program:
    """The `sequential_programming.Task` for IPOPT: unknowns of the law, then tops, parts >= 0, and J, all scaled."""

    def __init__(self, task):
        if task.quantile < 1:
            raise ValueError(f"IPOPT is asked for the worst resistance only, got `quantile` {task.quantile!r}")
        self.task, self.package = task, casadi()
        self.law = self.package.MX.sym("law", task.held.space.size)
        self.extra, self.first, self.held = [], [], []
        place, speed, change = map(self._moved, task.nodes[:3])
        self.scale = abs(task.kept(task.tangents(task.held.calmest))[1])
        top = self._new(1, 2.0)
        for k, resistance in enumerate(task.resistances):
            met = _spline(self.package, resistance, task)(speed, change)
            terms = [self._term(name, task.mass * change + met, met, speed) for name in task.weights]
            self.held.append(sum(w * term for w, term in zip(task.weights_of(k), terms, strict=False)) - top)
        self._hold_pitch(place, speed, change)
        self.solver = self._solver(top)

    def _moved(self, rows):
        return self.package.DM(sparse.csc_matrix(rows)) @ self.law

    def _new(self, count, start):
        self.extra.append(self.package.MX.sym("extra", count))
        self.first += [start] * count
        return self.extra[-1]

    def _term(self, name, force, met, speed):
        """A criterion over the scale; what is not smooth by a new unknown above it."""
        ca, weights = self.package, self.package.DM(self.task.nodes.weights)
        if name in PEAKS:
            values, top = (force if name == "peak_force" else force * speed) / self.scale, self._new(1, 2.0)
            self.held += [values - top, -values - top]
            return top
        if name == "rms_force":
            return ca.sqrt(ca.sum1(weights * (force / self.scale) ** 2) / float(np.sum(self.task.nodes.weights)))
        if name == "energy":
            return 2 * ca.sum1(weights * met * speed) / self.scale
        parts = self._new(weights.shape[0], 1.0)
        self.held += [force * speed / self.scale - parts, -parts]
        return 2 * ca.sum1(weights * parts)

    def _hold_pitch(self, place, speed, change):
        """kappa (r + R) and kappa (r - R) <= 1, there and back, as `pitch` has them."""
        pitch = self.task.held.pitch
        for sign in (1, -1) if pitch else ():
            q = sign * pitch.seconds
            rho, slope = pitch.breadth / 2 + sign * (place - pitch.stroke / 2), q * speed
            kappa = (rho**2 + 2 * slope**2 - rho * q * pitch.seconds * change) / (rho**2 + slope**2) ** 1.5
            spans = pitch.roller_radius + pitch.profile_radius, pitch.roller_radius - pitch.profile_radius
            self.held += [span * kappa - (1 - MARGIN) for span in spans]

    def _solver(self, top):
        ca, program = self.package, self.task.held.program
        below = self._moved(program.inequality_matrix) - program.inequality_bounds
        equal = self._moved(program.equality_matrix) - program.equality_values
        held = ca.vertcat(equal, below, *self.held)
        self.lowest = np.full(held.shape[0], -np.inf)
        self.lowest[: equal.shape[0]] = 0.0
        return ca.nlpsol("s", "ipopt", {"x": ca.vertcat(self.law, *self.extra), "f": top, "g": held}, SETTINGS)

    def solved(self, start):
        """(unknowns, J by IPOPT, iterations) from a law, or None."""
        found = self.solver(x0=np.append(start, self.first), lbg=self.lowest, ubg=0.0)
        stats = self.solver.stats()
        if not stats["success"]:
            return None
        return np.array(found["x"]).ravel()[: len(start)], self.scale * float(found["f"]), stats["iter_count"]


def _spline(package, resistance, task):
    """R(v, a) of columns of casadi."""
    mean = task.nodes.mean
    fastest, usual = task.held.limits.velocity or FASTEST * mean, 2 * mean / task.held.duration

    def sampled(count, change):
        speed = fastest * np.linspace(0, 1, count) ** 2  # crowded at rest
        moving = np.maximum(speed, 1e-9 * mean)
        return speed, np.broadcast_to(resistance(moving, np.full(count, change)), speed.shape)

    (grid, still), (_, later), (_, sooner) = (sampled(SAMPLES, change) for change in (0.0, usual, -usual))
    if max(np.abs(later - still).max(), np.abs(sooner - still).max()) <= SAME * np.abs(still).max():
        over = package.interpolant("R", "bspline", [grid], still)
        return lambda v, a: over(v.T).T
    shares = np.linspace(-WIDE, WIDE, SHARES)
    columns = [sampled(FEWER, usual * share / np.sqrt(1 - share**2)) for share in shares]
    grid, values = columns[0][0], np.array([column for _, column in columns])
    over = package.interpolant("R", "bspline", [grid, shares], values.ravel())
    return lambda v, a: over(package.horzcat(v, a / package.sqrt(a**2 + usual**2)).T).T
