"""Reference solution of optimal motion laws by IPOPT (casadi), independent of the sequential convex programming.

IPOPT solves the same discrete problem from any initial law: the criterion itself with its exact derivatives, the linear
constraints, and the curvature of a cam for a roller follower. The resistance is a cubic spline through its values over
the velocity and, where it depends on it, the acceleration; peaks and positive parts are epigraph variables.
"""

from dataclasses import replace

import casadi
import numpy as np
from scipy import sparse

from compact.motion.limits import CURVATURE_MARGIN
from compact.motion.optimal_motion import EXCHANGE_ROUNDS, OptimisationProblem
from compact.motion.optimisation_problem import PEAKS, ConstraintSet, spline_space_for
from compact.numerics.convex_programs import minimise_linear

VELOCITY_SAMPLES, GRID_SAMPLES, ACCELERATION_SAMPLES = 400, 120, 41  # [-], of the resistance: curve, or grid
VELOCITY_FACTOR = 4.0  # [-], times the mean velocity: largest sample of a resistance without a limit of velocity
SHARE_LIMIT = 0.999  # [-], largest u = a/(a^2 + A^2)^(1/2) of a sample; A is twice the mean velocity over the duration
INDEPENDENCE = 1e-12  # [-], relative change of a resistance that does not depend on the acceleration
RESTARTS = 3  # [-], initial laws tried after the first
CORNERS = 6  # [-], vertices of the feasible set whose mean is an initial law
SETTINGS = {"ipopt.print_level": 0, "print_time": 0, "ipopt.sb": "yes", "ipopt.max_iter": 2000, "ipopt.tol": 1e-8}


def random_laws(problem, count, seed=0):
    """Unknowns of laws all over the feasible set, shape (count, unknowns): means of random vertices."""
    random, space = np.random.default_rng(seed), problem.constraints.space
    laws = []
    for _ in range(count):
        corners = [minimise_linear(random.normal(size=space.size), problem.constraints.program) for _ in range(CORNERS)]
        laws.append(random.dirichlet(np.ones(CORNERS)) @ corners)
    return np.array(laws)


def multistart_values(problem, count, seed=0):
    """Criteria reached by IPOPT from random laws, ascending."""
    program = _NonlinearProgram(problem)
    solutions = map(program.solve, random_laws(problem, count, seed))
    return np.sort([value for _, value in filter(None, solutions)])


def find_optimal_law(limits, stroke, duration, weights, mass, resistances, pieces):
    """(curve, criterion) of the law that IPOPT finds, with peaks between the nodes added as nodes."""
    space = spline_space_for(limits, pieces)
    problem = OptimisationProblem(
        ConstraintSet(limits, space, stroke, duration), weights, mass, resistances, penalty=0.0
    )
    unknowns = problem.constraints.min_acceleration_law
    for _ in range(EXCHANGE_ROUNDS):
        unknowns = _solve_from_any(problem, unknowns)
        peaks = problem.peaks_between_nodes(unknowns)
        if not peaks:
            break
        problem = replace(problem, extra_phases=problem.extra_phases + peaks)
    return space.curve(problem.constraints.project(unknowns)), problem.value(unknowns)


def _solve_from_any(problem, unknowns):
    program = _NonlinearProgram(problem)
    for start in (unknowns, *random_laws(problem, RESTARTS)):
        if solution := program.solve(start):
            return solution[0]
    raise RuntimeError(f"IPOPT reached no law from {1 + RESTARTS} initial laws")


class _NonlinearProgram:
    """An `OptimisationProblem` for IPOPT: unknowns of the law, epigraph variables, parts >= 0, and J, all scaled."""

    def __init__(self, problem):
        self.problem = problem
        self.law = casadi.MX.sym("law", problem.constraints.space.size)
        self.extra, self.first, self.constraints = [], [], []
        position, velocity, acceleration = map(self._times_law, problem.nodes[:3])
        self.scale = abs(problem.value(problem.constraints.min_acceleration_law))
        top = self._new(1, 2.0)
        for resistance in problem.resistances:
            resisted = _spline(resistance, problem)(velocity, acceleration)
            force = problem.mass * acceleration + resisted
            terms = [self._term(name, force, resisted, velocity) for name in problem.weights]
            self.constraints.append(sum(w * t for w, t in zip(problem.weights.values(), terms, strict=True)) - top)
        self._add_curvature(position, velocity, acceleration)
        self.solver = self._solver(top)

    def _times_law(self, rows):
        return casadi.DM(sparse.csc_matrix(rows)) @ self.law

    def _new(self, count, start):
        self.extra.append(casadi.MX.sym("extra", count))
        self.first += [start] * count
        return self.extra[-1]

    def _term(self, name, force, resisted, velocity):
        """A criterion over the scale; one that is not smooth as an epigraph variable."""
        weights = casadi.DM(self.problem.nodes.weights)
        if name in PEAKS:
            values = (force if name == "peak_force" else force * velocity) / self.scale
            top = self._new(1, 2.0)
            self.constraints += [values - top, -values - top]
            return top
        if name == "rms_force":
            duration = float(np.sum(self.problem.nodes.weights))
            return casadi.sqrt(casadi.sum1(weights * (force / self.scale) ** 2) / duration)
        if name == "energy":
            return 2 * casadi.sum1(weights * resisted * velocity) / self.scale
        parts = self._new(weights.shape[0], 1.0)
        self.constraints += [force * velocity / self.scale - parts, -parts]
        return 2 * casadi.sum1(weights * parts)

    def _add_curvature(self, position, velocity, acceleration):
        """kappa (r + R) and kappa (r - R) <= 1 of both strokes."""
        pitch = self.problem.constraints.pitch
        for sign in (1, -1) if pitch else ():
            q = sign * pitch.seconds_per_radian
            rho, slope = pitch.breadth / 2 + sign * (position - pitch.stroke / 2), q * velocity
            second = q * pitch.seconds_per_radian * acceleration
            kappa = (rho**2 + 2 * slope**2 - rho * second) / (rho**2 + slope**2) ** 1.5
            spans = pitch.roller_radius + pitch.profile_radius, pitch.roller_radius - pitch.profile_radius
            self.constraints += [span * kappa - (1 - CURVATURE_MARGIN) for span in spans]

    def _solver(self, top):
        program = self.problem.constraints.program
        below = self._times_law(program.inequality_matrix) - program.inequality_bounds
        equal = self._times_law(program.equality_matrix) - program.equality_values
        constraints = casadi.vertcat(equal, below, *self.constraints)
        self.lowest = np.full(constraints.shape[0], -np.inf)
        self.lowest[: equal.shape[0]] = 0.0
        unknowns = casadi.vertcat(self.law, *self.extra)
        return casadi.nlpsol("s", "ipopt", {"x": unknowns, "f": top, "g": constraints}, SETTINGS)

    def solve(self, start):
        """(unknowns, J by IPOPT) from an initial law, or None if IPOPT fails."""
        solution = self.solver(x0=np.append(start, self.first), lbg=self.lowest, ubg=0.0)
        if not self.solver.stats()["success"]:
            return None
        return np.array(solution["x"]).ravel()[: len(start)], self.scale * float(solution["f"])


def _spline(resistance, problem):
    """R(v, a) of columns of casadi."""
    mean, duration = problem.nodes.mean_velocity, problem.constraints.duration
    fastest, usual = problem.constraints.limits.velocity or VELOCITY_FACTOR * mean, 2 * mean / duration

    def sample(count, acceleration):
        velocity = fastest * np.linspace(0, 1, count) ** 2  # graded towards rest
        moving = np.maximum(velocity, 1e-9 * mean)
        return velocity, np.broadcast_to(resistance(moving, np.full(count, acceleration)), velocity.shape)

    (grid, at_zero), (_, above), (_, below) = (sample(VELOCITY_SAMPLES, a) for a in (0.0, usual, -usual))
    if max(np.abs(above - at_zero).max(), np.abs(below - at_zero).max()) <= INDEPENDENCE * np.abs(at_zero).max():
        curve = casadi.interpolant("R", "bspline", [grid], at_zero)
        return lambda v, _: curve(v.T).T
    shares = np.linspace(-SHARE_LIMIT, SHARE_LIMIT, ACCELERATION_SAMPLES)
    columns = [sample(GRID_SAMPLES, usual * share / np.sqrt(1 - share**2)) for share in shares]
    grid, values = columns[0][0], np.array([column for _, column in columns])
    surface = casadi.interpolant("R", "bspline", [grid, shares], values.ravel())
    return lambda v, a: surface(casadi.horzcat(v, a / casadi.sqrt(a**2 + usual**2)).T).T
