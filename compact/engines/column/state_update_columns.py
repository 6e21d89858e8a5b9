"""Column engine for an own material law: one pass of a roller over a layer whose law is a `StateUpdate`.

A layer of one mix under a roller is kinematically determined in confined compression. With the gap of the roller and
the indentation d, a column of fed height H has

    h(x) = H - d + gap(x),    e_yy = ln(h/H),    P = int s_v dx,    F = int s_v dgap,    s_v = -s_yy.

The law receives the increments of e_yy from the front edge to the lowest generatrix, and from there until s_v = 0, the
rear edge. Both paths have equal increments of x. The integrals are trapezoidal sums. The number of increments is
doubled until load and resistance change by less than a tolerance; their last change is the error estimate. The exit
density ratio follows from the volume, k = k_fed H/h, and thus contains the elastic strain that remains.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.optimize import brentq

from compact import rolling_contact
from compact.engines.column import COLUMN
from compact.engines.column.column_ode import GapShape
from compact.engines.column.column_pass import REBOUND_SHARE_MAX, solve_target
from compact.material.state_update import StateUpdate
from compact.numerics import Array
from compact.numerics.validation import require_positive
from compact.rolling_contact import Contact, Layer, Roller

INCREMENTS = 64  # [-], of the front, at first
INCREMENTS_MAX = 16_384  # [-], of the front; some second of a law in Python
CLOSED_PORES = 1e-6  # [-], share of the pores that the largest indentation leaves
RTOL = 1e-4  # [-], default tolerance of load and resistance
SEARCH_TOLERANCE = 1e-9  # [-], relative error of the indentation that is sought


def roll_state_update(
    layer: Layer,
    roller: Roller,
    material: StateUpdate,
    speed: float,
    *,
    exit_density_ratio: float | None = None,
    rtol: float = RTOL,
) -> Contact:
    """Compute one pass of a roller over a bonded layer of an own material.

    Parameters
    ----------
    layer : Layer
        Layer of one mix on a rigid base.
    roller : Roller
        Roller with the gap of a parabola or of a circle.
    material : StateUpdate
        Material law.
    speed : float
        Speed of the roller along x [m/s], of which the sign alone enters.
    exit_density_ratio : float, optional
        Density ratio after the pass [-], in place of the target of the roller.
    rtol : float
        Tolerance of load and resistance [-].

    Returns
    -------
    Contact

    Raises
    ------
    ValueError
        If no indentation reaches the target.
    RuntimeError
        If the increments do not suffice, or the rebound does not end.
    """
    COLUMN.require(layer, roller, speed)
    require_positive(rtol=rtol)
    if layer.lower_lift is not None:
        raise ValueError("an own material needs a layer on the rigid base, got a `lower_lift`; use a law of the mix")
    target = roller.target if exit_density_ratio is None else ("exit_density_ratio", exit_density_ratio)
    own = _OwnLayer(layer, material, GapShape(roller.radius, 0.0 if roller.profile == "parabola" else 1.0))

    def at_target(count: int) -> Contact:
        return solve_target(own, lambda depth: own.compute_pass(depth, count), *target, SEARCH_TOLERANCE)

    count, error, found = INCREMENTS, (np.inf, np.inf), at_target(INCREMENTS)
    while max(error) > rtol:
        if count >= INCREMENTS_MAX:
            raise RuntimeError(
                f"the contact over {material.name} changes by {max(error):.1e} from {count // 2} to {count} "
                f"increments, tolerance {rtol:g}; the law may jump, so smooth it or raise `rtol`"
            )
        count, before = 2 * count, found
        found = at_target(count)
        scale = rolling_contact.resistance_scale(found.resistance, found.load)
        error = abs(found.load - before.load) / found.load, abs(found.resistance - before.resistance) / scale
    result = rolling_contact.for_travel(replace(found, error=error), speed)
    return rolling_contact.require_on_target(result, roller, 10 * rtol, exit_density_ratio=exit_density_ratio)


class _OwnLayer:
    """Layer of an own material under a roller, with the limits of a search as of `ColumnLayer`."""

    def __init__(self, layer: Layer, material: StateUpdate, gap: GapShape) -> None:
        self.layer, self.material, self.gap = layer, material, gap
        self.height, self.loosest = layer.height, material.fed_density_ratio
        pores = layer.height * (1 - self.loosest)
        self.max_indentation = (1 - CLOSED_PORES) * (min(pores, gap.radius) if gap.circular else pores)
        self.limit = f"the pores of {material.name} close, or the circle is buried to its axis"

    def estimate(self, name: str, depth: float) -> float:
        """Return nothing: the search begins at the largest indentation."""
        return 0.0

    def compute_pass(self, indentation: float, count: int) -> Contact:
        """Compute the pass along +x at an indentation [m] with a number of increments of the front."""
        lowest, front = self.layer.height - indentation, self.gap.edge(indentation)
        limit, step = self.gap.edge(min(REBOUND_SHARE_MAX * indentation, self.gap.radius * (1 - 1e-9))), front / count
        places = np.append(np.linspace(front, 0.0, count + 1), -step * np.arange(1, int(limit / step) + 1))
        heights = lowest + self.gap.at(places)
        heights[0] = self.layer.height
        state, stresses = self.material.initial_state, [0.0]
        for reached in range(1, len(places)):
            stress, after = self._advance(state, heights[reached - 1 : reached + 1])
            if reached > count and stress <= 0:
                break
            state = after
            stresses.append(stress)
        else:
            raise RuntimeError(
                f"the rebound of {self.material.name} does not end: a vertical stress of {stresses[-1]:.6g} Pa remains "
                f"{-places[-1]:.6g} m behind the lowest generatrix; use a smaller indentation"
            )
        start = places[reached - 1], heights[reached - 1]

        def unload(place: float) -> tuple[float, Any]:
            return self._advance(state, np.array([start[1], lowest + self.gap.at(np.array(place))]))

        rear = brentq(lambda place: stresses[-1] if place == start[0] else unload(place)[0], places[reached], start[0])
        exit_height = float(lowest + self.gap.at(np.array(rear)))
        x, pressure = np.append(places[:reached], rear)[::-1], np.append(stresses, 0.0)[::-1]
        return Contact(
            load=float(np.trapezoid(pressure, x)), resistance=float(np.trapezoid(pressure, self.gap.at(x))),
            leading=float(x[-1]), trailing=rear, x=x, pressure=pressure, shear_traction=np.zeros_like(x),
            peak_pressure=float(pressure.max()), indentation=indentation, exit_height=exit_height,
            exit_density_ratio=self.material.fed_density_ratio * self.layer.height / exit_height,
            mass_residual=0.0, exit=unload(rear)[1], own={"increments": count},
        )  # fmt: skip

    def _advance(self, state: Any, heights: Array) -> tuple[float, Any]:
        """Return the vertical stress [Pa] and the state after one increment between two heights [m]."""
        strain = float(np.diff(np.log(heights))[0])
        stress, after, _ = self.material.advance(state, np.array([0.0, strain, 0.0, 0.0]))
        return -float(stress[1]), after
