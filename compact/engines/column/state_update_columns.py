"""Column engine for an own material law: one pass of a roller over a layer whose law is a `StateUpdate`.

A layer of one mix under a roller is kinematically determined in confined compression. With the gap of the roller and
the indentation d, a column of fed height H has

    h(x) = H - d + gap(x),    e_yy = ln(h/H),    P = int s_v dx,    F = int s_v dgap,    s_v = -s_yy.

The law receives the increments of e_yy from the front edge to the lowest generatrix, and from there until s_v = 0, the
rear edge. Both paths have equal increments of x. The integrals are trapezoidal sums. The number of increments is
doubled until load and resistance change by less than a tolerance; their last change is the error estimate. The exit
density ratio follows from the volume, k = k_fed H/h, and thus contains the elastic strain that remains.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import brentq

from compact import rolling_contact
from compact.engines.column.column_ode import GapShape
from compact.material.state_update import StateUpdate
from compact.numerics import Array
from compact.numerics.validation import require_positive
from compact.rolling_contact import Contact, Layer, Roller

INCREMENTS = 64  # [-], of the front, at first
INCREMENTS_MAX = 16_384  # [-], of the front; some second of a law in Python
REBOUND_MAX = 2.0  # [-], rise of the gap behind the roller over the indentation, in which the unloading must end
LEAST_INDENTATION = 1e-6  # [-], of the largest one, in the search for a target
RTOL = 1e-4  # [-], default tolerance of load and resistance


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
    rolling_contact.require_moving(speed)
    require_positive(rtol=rtol)
    if layer.lower_lift is not None:
        raise ValueError("an own material needs a layer on the rigid base, got a `lower_lift`; use a law of the mix")
    name, target = roller.target if exit_density_ratio is None else ("exit_density_ratio", exit_density_ratio)
    layer_of_law = _OwnLayer(layer, material, GapShape(roller.radius, 0.0 if roller.profile == "parabola" else 1.0))
    count, before, change = INCREMENTS, layer_of_law.solve_target(name, target, INCREMENTS, rtol), np.inf
    while change > rtol:
        if count >= INCREMENTS_MAX:
            raise RuntimeError(
                f"the contact over {material.name} changes by {change:.1e} from {count // 2} to {count} "
                f"increments, tolerance {rtol:g}; the law may jump, so smooth it or raise `rtol`"
            )
        count *= 2
        found = layer_of_law.solve_target(name, target, count, rtol)
        of_resistance = abs(found.resistance - before.resistance) / rolling_contact.resistance_scale(
            found.resistance, found.load
        )
        found = replace(found, error=(abs(found.load - before.load) / found.load, of_resistance))
        before, change = found, max(found.error or ())
    result = rolling_contact.for_travel(before, speed)
    rolling_contact.require_on_target(result, roller, 10 * rtol, exit_density_ratio=exit_density_ratio)
    return result


def required_height(height: float, exit_density_ratio: float, material: StateUpdate) -> float:
    """Return the height of fresh mix for a product of a height [m] and a density ratio [-] after its rebound [m]."""
    require_positive(height=height)
    if not material.fed_density_ratio < exit_density_ratio < 1:
        raise ValueError(
            f"`exit_density_ratio` must lie between `fed_density_ratio` {material.fed_density_ratio!r} of "
            f"{material.name} and 1, got {exit_density_ratio!r}"
        )
    return height * exit_density_ratio / material.fed_density_ratio


@dataclass(frozen=True)
class _OwnLayer:
    """Layer of an own material under a roller."""

    layer: Layer
    material: StateUpdate
    gap: GapShape

    def solve_target(self, name: str, target: float, count: int, rtol: float) -> Contact:
        """Compute the pass in which a quantity equals its target, with a number of increments of the front."""
        deepest = self.layer.height * (1 - self.material.fed_density_ratio)
        deepest = min(deepest, self.gap.radius) if self.gap.circular else deepest
        if name == "indentation":
            if not target < deepest:
                raise ValueError(
                    f"`indentation` must be less than {deepest:.6g} m, got {target!r}: it closes all pores"
                )
            return self.compute_pass(target, count)

        def excess(indentation: float) -> float:
            return float(getattr(self.compute_pass(indentation, count), name)) - target

        least, most = LEAST_INDENTATION * deepest, deepest * (1 - LEAST_INDENTATION)
        if excess(most) < 0:
            raise ValueError(
                f"`{name}` {target:.6g} is not reached by {self.material.name} before its pores close; prescribe less"
            )
        return self.compute_pass(float(brentq(excess, least, most, rtol=min(rtol / 10, 1e-6))), count)

    def compute_pass(self, indentation: float, count: int) -> Contact:
        """Compute the pass along +x at an indentation [m] with a number of increments of the front."""
        lowest, front = self.layer.height - indentation, self.gap.edge(indentation)
        ahead = np.linspace(front, 0.0, count + 1)
        heights = lowest + self.gap.at(ahead)
        heights[0] = self.layer.height
        stresses, state = self._advance(self.material.initial_state, heights)
        limit = self.gap.edge(min(REBOUND_MAX * indentation, self.gap.radius * (1 - 1e-9)))
        rear, behind = [0.0], [stresses[-1]]

        def unload(place: float) -> tuple[float, Any]:
            stress, after = self._advance(state, lowest + self.gap.at(np.array([rear[-1], place])))
            return float(stress[1]), after

        while behind[-1] > 0:
            end = rear[-1] + front / count
            if end > limit:
                raise RuntimeError(
                    f"the rebound of {self.material.name} does not end: a vertical stress of {behind[-1]:.6g} Pa "
                    f"remains {rear[-1]:.6g} m behind the lowest generatrix; use a smaller indentation"
                )
            remaining, after = unload(end)
            if remaining <= 0:
                end = float(brentq(lambda place: behind[-1] if place == rear[-1] else unload(place)[0], rear[-1], end))
                remaining, after = 0.0, unload(end)[1]
            state = after
            rear.append(end)
            behind.append(remaining)
        x = np.concatenate([-np.array(rear[:0:-1]), ahead[::-1]])
        stress = np.concatenate([np.array(behind[:0:-1]), stresses[::-1]])
        exit_height = float(lowest + self.gap.at(np.array(rear[-1])))
        return Contact(
            load=float(np.trapezoid(stress, x)), resistance=float(np.trapezoid(stress, self.gap.at(x))),
            leading=float(x[-1]), trailing=float(x[0]), x=x, pressure=stress, shear_traction=np.zeros_like(x),
            peak_pressure=float(stress.max()), indentation=indentation, exit_height=exit_height,
            exit_density_ratio=self.material.fed_density_ratio * self.layer.height / exit_height,
            mass_residual=0.0, exit=state, own={"increments": count},
        )  # fmt: skip

    def _advance(self, state: Any, heights: Array) -> tuple[Array, Any]:
        """Return the vertical stress at each height of a path, the first one without stress, and the last state."""
        stresses = np.zeros(len(heights))
        for number, strain in enumerate(np.diff(np.log(heights)).tolist(), start=1):
            stress, state, _ = self.material.advance(state, np.array([0.0, strain, 0.0, 0.0]))
            stresses[number] = -stress[1]
        return stresses, state
