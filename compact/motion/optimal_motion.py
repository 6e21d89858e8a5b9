"""Optimal motion of a cart: the motion law that minimises a drive criterion.

    minimise J(H, P),   H = m a + R(v, a),   P = H v,   forward and return stroke

The criteria are those of `objectives`, the constraints those of `limits`, and the method is sequential convex
programming on a spline space (`sequential_programming`).
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from compact.motion.limits import Limits
from compact.motion.objectives import OBJECTIVES, Resistance
from compact.motion.profile import LARGEST, SMALLEST, MotionProfile
from compact.motion.sequential_programming import DriveCriterion, find_optimal_law
from compact.numerics import validation

PROGRAM_TOLERANCE = 1e-6  # [-], of the largest value of a derivative: a smaller jump is left by the convex programs
PIECES_LIMIT = 1024  # [-], of an optimal law: dense programs of 0.1 GB; the memory grows with the square of the pieces


@dataclass(frozen=True)
class OptimalMotion(MotionProfile):
    """A `MotionProfile` found by `optimise`, and the record of the search.

    Attributes
    ----------
    value : float
        Minimum of the criterion over forward and return stroke without dwells, in the unit of the criterion.
    gap, refinement : float
        Relative optimality gap, see `sequential_programming.optimality_gap`, and relative decrease by the last halving
        of the pieces, nan without one [-].
    steps : int
        Number of convex subproblems accepted.
    """

    value: float = np.nan
    gap: float = np.nan
    refinement: float = np.nan
    steps: int = 0
    limits: Limits = field(default_factory=Limits)
    jump_tolerance: ClassVar[float] = PROGRAM_TOLERANCE


def optimise(  # noqa: PLR0913, public signature: each argument is one physical input
    objective: str | Mapping[str, float],
    stroke: float,
    duration: float,
    mass: float,
    resistance: Resistance | Sequence[Resistance],
    limits: Limits | None = None,
    *,
    quantile: float = 1.0,
    regret: bool = False,
    pieces: int | None = None,
) -> OptimalMotion:
    """Find the motion law that minimises a drive criterion of a cart over forward and return stroke.

    Parameters
    ----------
    objective : str or mapping of str to float
        Name in `OBJECTIVES`: "peak_force" [N], "peak_power" [W], "rms_force" [N], "energy" (net work) [J],
        "drawn_energy" (work where P > 0) [J]; or the weights >= 0 of a weighted sum by name.
    stroke : float
        Travel of one pass [m], > 0.
    duration : float
        Time of one pass [s], > 0.
    mass : float
        Mass of the cart [kg], >= 0.
    resistance : callable or sequence of callables
        R(velocity [m/s], acceleration [m/s^2]) -> [N] of the forward stroke, velocity > 0, for arrays of any shape; the
        return stroke is its mirror image. It may include guide friction. For several resistances, the criterion is
        the largest value over them, or the `quantile`.
    limits : Limits, optional
        Constraints at every instant; without them the velocity is nonnegative.
    quantile : float
        Quantile of the criterion over the resistances, from 0 to 1.
    regret : bool
        Divide the criterion of each resistance by its minimum for that resistance alone (minimax regret).
    pieces : int, optional
        Number of polynomial pieces of the acceleration and deceleration phases.

    Returns
    -------
    OptimalMotion
        One of the minimisers where there are several; a small weight of "rms_force" selects the smoothest.

    Raises
    ------
    InfeasibleError
        If no law satisfies the limits; the error states which limits to relax, and by how much.
    RuntimeError
        If the search does not converge.

    Examples
    --------
    >>> def none(velocity, acceleration): return 0 * velocity
    >>> m = optimise("peak_force", stroke=0.4, duration=3.0, mass=1000.0, resistance=none)
    >>> f"{m.value:.3f} N = 4 m stroke/duration^2, gap below 1e-9: {m.gap < 1e-9}"
    '177.778 N = 4 m stroke/duration^2, gap below 1e-9: True'
    """
    validation.require_instance((str, Mapping), "the name of an objective, or weights by name", objective=objective)
    weights = {objective: 1.0} if isinstance(objective, str) else dict(objective)
    resistances = (resistance,) if callable(resistance) else tuple(resistance)
    _require_valid(objective, weights, stroke, duration, mass, resistances, quantile, pieces)
    limits = limits or Limits()
    stroke, duration = float(stroke), float(duration)
    criterion = DriveCriterion(weights, float(mass), resistances, quantile)
    if regret:
        alone = (DriveCriterion(weights, float(mass), (one,)) for one in resistances)
        minima = tuple(find_optimal_law(limits, stroke, duration, one, pieces).value for one in alone)
        criterion = replace(criterion, minima=minima)  # regret
    found = find_optimal_law(limits, stroke, duration, criterion, pieces)
    return OptimalMotion(
        optimal_law_name(weights), stroke, duration, found.curve, False,
        found.value, found.gap, found.refinement, found.steps, limits,
    )  # fmt: skip


def optimal_law_name(objectives: Iterable[str]) -> str:
    """Return the name of the optimal law for the names of its objectives, such as "least-peak-force"."""
    return "least-" + "-and-".join(objectives).replace("_", "-")


def _require_valid(objective, weights, stroke, duration, mass, resistances, quantile, pieces):
    for name in weights:
        validation.require_known("objective", name, tuple(OBJECTIVES))
    validation.require_number(stroke=stroke, duration=duration, mass=mass, quantile=quantile)
    validation.require_positive(stroke=stroke, duration=duration, quantile=quantile)
    validation.require_between(SMALLEST, LARGEST, stroke=stroke, duration=duration)
    validation.require_nonnegative(mass=mass, weights=list(weights.values()))
    if not any(weights.values()):
        raise ValueError(f"`objective` must have at least one weight > 0, got {objective!r}; raise a weight")
    validation.require_between(0, 1, quantile=quantile)
    if pieces is not None:
        validation.require_integers(pieces=pieces)
        validation.require_at_most(PIECES_LIMIT, "more pieces lower no criterion by a measurable amount", pieces=pieces)
    for one in resistances:
        validation.require_opposing(one, stroke / duration, directions=(1.0,))
