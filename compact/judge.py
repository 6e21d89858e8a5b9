"""A second opinion on optimal laws: the same program by IPOPT, from many starts (casadi, the extra `optimise`).

Nothing of the steps, tangents and trust regions of `optimise` is used: IPOPT sees the criterion itself, with its exact
derivatives, and the linear limits. The resistance enters by a cubic spline through its values over the speed.
"""

import numpy as np
from scipy import sparse

from compact.quadratic import least_linear

SAMPLES = 400  # of the resistance over the speed
FASTEST = 4.0  # times the mean speed, up to which a resistance without a limit of speed is asked
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
        corners = [least_linear(random.normal(size=size), task.held.program) for _ in range(CORNERS)]
        found.append(random.dirichlet(np.ones(CORNERS)) @ corners)
    return np.array(found)


def best(task, count, seed=0):
    """(least criterion, all that were reached, rising) by IPOPT from so many starts, of peaks of force or power.

    task : an `optimise.Task` of one criterion among `criteria.PEAKS`

    Raises RuntimeError without casadi, and where no start leads to a law.
    """
    package = casadi()
    ((name, _),) = task.weights.items()
    unknowns, top = package.MX.sym("c", task.held.space.size), package.MX.sym("top")
    nodes, program = task.nodes, task.held.program
    speed, change = (package.DM(sparse.csc_matrix(rows)) @ unknowns for rows in (nodes.speed, nodes.change))
    peaks = []
    for resistance in task.resistances:
        force = task.mass * change + _spline(package, resistance, nodes.mean)(speed.T).T
        peaks.append(force if name == "peak_force" else force * speed)
    peaks = package.vertcat(*peaks)
    scale = np.abs(task.kept(task.tangents(task.held.calmest))[1])
    held = package.vertcat(
        package.DM(sparse.csc_matrix(program.equal)) @ unknowns - program.equal_to,
        package.DM(sparse.csc_matrix(program.below)) @ unknowns - program.below_to,
        peaks / scale - top,
        -peaks / scale - top,
    )
    solver = package.nlpsol("s", "ipopt", {"x": package.vertcat(unknowns, top), "f": top, "g": held}, SETTINGS)
    lowest = np.full(held.shape[0], -np.inf)
    lowest[: len(program.equal)] = 0.0
    reached = []
    for start in starts(task, count, seed):
        found = solver(x0=np.append(start, 1.0), lbg=lowest, ubg=0.0)
        if solver.stats()["success"]:
            reached.append(scale * float(found["f"]))
    if not reached:
        raise RuntimeError(f"IPOPT reached a law from none of {count} starts")
    return min(reached), np.sort(reached)


def _spline(package, resistance, mean):
    grid = np.linspace(0, FASTEST * mean, SAMPLES)
    values = np.broadcast_to(resistance(np.maximum(grid, 1e-9 * mean), np.zeros(SAMPLES)), grid.shape)
    return package.interpolant("R", "bspline", [grid], values)
