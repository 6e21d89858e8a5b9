"""Engine "column": compaction of a layer as independent confined columns, in one pass of a roller or several.

    h(x) = h_min + gap(x),    P = int s_v dx,    F = int s_v gap' dx = closed integral of s_v dh

Each column is compressed as in an oedometer (`column_ode`). The contact extends from the front edge, at the initial
height, to the rear edge, where the rebound ends and s_v = 0. This is the limit of a wide thin bonded layer without
friction. The difference to plane strain is of second order in height over contact length; `error` does not contain it.
F is the work retained by the layer. It depends on the lowest height alone, not on radius or profile, and on the speed
and the radius through the rate of compaction in pc only (`rolling_contact.compaction_rate`).

Mass is measured by the height that grains and water fill, density ratio times height; the gap cannot be smaller.
Several passes, and new mix on compacted mix, are columns on top of one another that share s_v and retain their state.
So is a layer on a lower lift; its height and density after the pass do not contain those of the lower lift.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from compact import rolling_contact
from compact.engines.column import COLUMN, column_pass
from compact.engines.column.column_ode import COLUMN_STATE, STRESS, GapShape, PathControl
from compact.engines.column.column_pass import PLATE, Column, ColumnLayer, column_layer
from compact.engines.column.state_update_columns import roll_state_update
from compact.material.cap_plasticity import CapConstants, cap_constants, compacted_state
from compact.material.laws import Compaction
from compact.material.state_update import StateUpdate
from compact.numerics import Array
from compact.numerics.validation import require_known, require_nonnegative, require_positive
from compact.rolling_contact import Contact, Layer, LowerLift, Roller

INTEGRATION_RTOL = 1e-9  # [-], default error of a step over the size of the whole pass
FEED_TRIALS_MAX = 20  # [-], of the rate factor of a feed; each reduces its error some thousandfold
ERROR_RTOL_RATIO = 100.0  # [-], `rtol` of the comparison pass over `rtol`; the difference is the error estimate


@dataclass(frozen=True)
class RequiredFeed:
    """Feed for a product of prescribed height and density.

    Parameters
    ----------
    height : float
        Height of fresh mix [m].
    indentation : float
        Indentation of the roller [m].
    """

    height: float
    indentation: float


@dataclass(frozen=True)
class OedometerResult:
    """Confined compression at prescribed vertical stresses, arrays of shape (n,).

    Parameters
    ----------
    pressure, lateral_stress : ndarray
        Vertical stress s_v and lateral stress s_h [Pa].
    strain, density_ratio : ndarray
        (h_in - h)/h_in and density ratio k [-].
    """

    pressure: Array
    strain: Array
    lateral_stress: Array
    density_ratio: Array


def roll(layer: Layer, roller: Roller, material: Compaction | StateUpdate, speed: float, **options: Any) -> Contact:
    """Compute one pass over a layer of fresh mix by the engine "column".

    Parameters
    ----------
    layer : Layer
        Layer of fresh mix, bonded, without plies; it may lie on a lower lift.
    roller : Roller
        Roller of any profile; "deformed" is the circle, since columns move vertically. It prescribes an indentation,
        load or peak pressure. "frictionless" and "free" rollers are equivalent.
    material : Compaction or StateUpdate
        Material law; an own law is computed by `state_update_columns.roll_state_update`, which states the range of
        layer and roller.
    speed : float
        Speed of the roller along x [m/s], not 0; it enters by its sign and by the rate of compaction in pc.
    **options
        Keywords of `roll_over`.

    Returns
    -------
    Contact
        For speed < 0 leading and trailing remain positive ahead; x and resistance refer to the fixed axis x.

    Examples
    --------
    >>> from compact.rolling_contact import Layer, Roller
    >>> mix = Compaction(unloading_modulus=120e6, poisson=0.3, heckel_slope=13e-6,
    ...                  loose_density_ratio=0.72, critical_slope=1.2, tensile_strength=14e3, fed_density_ratio=0.94)
    >>> fed = required_feed(0.22, 0.98, mix, speed=0.2)
    >>> rolled = roll(Layer(fed.height), Roller(0.11, indentation=fed.indentation, profile="circle"), mix, speed=0.2)
    >>> f"P {rolled.load:.0f} N/m, F/P {rolled.resistance / rolled.load:.3f}, k {rolled.exit_density_ratio:.3f}"
    'P 10035 N/m, F/P 0.165, k 0.980'
    """
    COLUMN.require(layer, roller, speed)
    if isinstance(material, StateUpdate):
        return roll_state_update(layer, roller, material, speed, **options)
    _require_compaction(material)
    lower = lower_columns(layer.lower_lift, material, roller.radius, speed)
    columns = (Column(layer.height, material.fed_density_ratio),)
    return roll_over(columns, roller, material, speed, lower=lower, **options)


def roll_over(
    columns: Sequence[Column],
    roller: Roller,
    material: Compaction,
    speed: float,
    *,
    exit_density_ratio: float | None = None,
    strain: Literal["logarithmic", "small"] = "logarithmic",
    rtol: float = INTEGRATION_RTOL,
    lower: Sequence[Column] = (),
) -> Contact:
    """Compute one pass over columns on top of one another.

    Parameters
    ----------
    columns : sequence of Column
        Columns from the base upwards.
    roller, material, speed
        See `roll`.
    exit_density_ratio : float, optional
        Mean density ratio after the pass [-], in place of the target of the roller.
    strain : {"logarithmic", "small"}
        Strain measure: logarithmic, which conserves mass, or small, which refers to the heights before the pass.
    rtol : float
        Error of a step over the size of the whole pass [-].
    lower : sequence of Column
        Columns of a lower lift below the others; heights and density ratios of the result refer to the others.

    Raises
    ------
    RuntimeError
        If the integration or the search for the indentation does not converge.
    """
    _require_compaction(material)
    COLUMN.require(None, roller, speed)
    require_known("strain", strain, ("logarithmic", "small"))
    require_positive(rtol=rtol)
    gap = GapShape(float(roller.radius), 0.0 if roller.profile == "parabola" else 1.0)
    layer = column_layer((*lower, *columns), material, 1.0, gap)
    layer = replace(layer, logarithmic=strain == "logarithmic", lower_count=len(lower))
    if material.rate_sensitivity:
        grains = sum(column_pass.grain_height(each, layer.law.K) for each in columns)
        fed_height = grains / material.fed_density_ratio  # of the columns, which earlier passes may have compacted
        deepest = fed_height * (1 - material.fed_density_ratio)  # a lower lift settles too
        settled = fed_height - sum(each.height for each in columns)

        def law_at(indentation: float) -> CapConstants:
            depth = min(settled + indentation, deepest)
            rate = rolling_contact.compaction_rate(speed, roller.radius, fed_height, depth)
            return cap_constants(material, material.rate_factor(rate))

        layer = replace(layer, law=law_at(layer.max_indentation), law_at=law_at)
    target = roller.target if exit_density_ratio is None else ("exit_density_ratio", exit_density_ratio)
    result = _sampled_pass(layer, *target, rtol)
    coarse = layer.compute_pass(result.indentation, ERROR_RTOL_RATIO * rtol)
    scale = rolling_contact.resistance_scale(result.resistance, result.load)
    error = abs(coarse.load - result.load) / result.load, abs(coarse.resistance - result.resistance) / scale
    rolled = rolling_contact.for_travel(replace(result, error=(error[0] + rtol, error[1] + rtol)), speed)
    tolerance = column_pass.TARGET_TOLERANCE * rtol
    return rolling_contact.require_on_target(rolled, roller, tolerance, exit_density_ratio=exit_density_ratio)


def lower_columns(lift: LowerLift | None, material: Compaction, radius: float | None, speed: float) -> Sequence[Column]:
    """Return the column of a lower lift before the pass; none on the rigid base.

    Parameters
    ----------
    lift : LowerLift or None
        Thickness, density ratio and residual stress.
    material : Compaction
        Material law.
    radius : float or None
        Roller radius [m]; None for a mix without rate sensitivity.
    speed : float
        Speed of the earlier pass [m/s].
    """
    if lift is None:
        return ()
    rate = 0.0 if radius is None else lift.compaction_rate(speed, radius, material.fed_density_ratio)
    rate_factor = material.rate_factor(rate)
    point = compacted_state(material, lift.density_ratio, rate_factor, residual_stress=lift.residual_stress)
    return (Column(lift.thickness, lift.density_ratio, -float(point.stress[0, 0]), float(point.max_density_ratio[0])),)


def required_feed(
    height: float,
    exit_density_ratio: float,
    material: Compaction,
    speed: float,
    *,
    radius: float | None = None,
    lower_lift: LowerLift | None = None,
) -> RequiredFeed:
    """Compute the height of fresh mix and the indentation for a product after one pass and its rebound.

    Parameters
    ----------
    height : float
        Height of the product [m].
    exit_density_ratio : float
        Density ratio of the product [-].
    speed : float
        Speed of the roller [m/s].
    radius : float, optional
        Roller radius [m]; required for a mix with a rate sensitivity.
    lower_lift : LowerLift, optional
        Lift below, whose settlement adds to the indentation.

    Returns
    -------
    RequiredFeed
        Both lengths are proportional to `height` on the rigid base for a mix without rate sensitivity.
    """
    require_positive(height=height)
    _require_compaction(material)
    if material.rate_sensitivity and radius is None:
        raise ValueError("`radius` must be given for a mix with a rate sensitivity, got None")
    factor, rtol, lower = 1.0, INTEGRATION_RTOL, lower_columns(lower_lift, material, radius, speed)
    name, tolerance = "exit_density_ratio", column_pass.TARGET_TOLERANCE * rtol
    for _ in range(FEED_TRIALS_MAX):
        # the density after a pass depends on its lowest height alone, so that a plate stands for the roller
        fresh = column_layer((Column(1.0, material.fed_density_ratio),), material, factor, PLATE)
        result = _sampled_pass(fresh, name, exit_density_ratio, rtol)
        rolling_contact.require_target_reached(name, exit_density_ratio, result.exit_density_ratio, tolerance)
        scale, settlement = height / result.exit_height, 0.0
        if lower:
            below = column_layer(lower, material, factor, PLATE)
            settlement = column_pass.plate_indentation(below, result.peak_pressure, rtol)
        feed, before = RequiredFeed(height=scale, indentation=scale * result.indentation + settlement), factor
        if radius is not None:
            rate = rolling_contact.compaction_rate(speed, radius, feed.height, feed.indentation)
            factor = material.rate_factor(rate)
        if abs(factor / before - 1) <= rtol:
            return feed
    raise RuntimeError(f"the rate of compaction still changes by {abs(factor / before - 1):.1e}")


def simulate_oedometer(material: Compaction, pressure: ArrayLike) -> OedometerResult:
    """Simulate confined compression of fresh mix through vertical stresses in turn, up or down.

    Parameters
    ----------
    pressure : array_like
        Vertical stresses s_v [Pa], shape (n,).

    Raises
    ------
    ValueError
        If a stress is negative or closes all pores.

    Examples
    --------
    >>> mix = Compaction(unloading_modulus=120e6, poisson=0.3, heckel_slope=13e-6,
    ...                  loose_density_ratio=0.72, critical_slope=1.2, tensile_strength=14e3, fed_density_ratio=0.94)
    >>> test = simulate_oedometer(mix, (100e3, 200e3, 0.0))
    >>> [f"{k:.4f}" for k in test.density_ratio], f"residual stress {test.lateral_stress[-1] / 1e3:.0f} kPa"
    (['0.9400', '0.9707', '0.9707'], 'residual stress 43 kPa')
    """
    _require_compaction(material)
    pressure = np.atleast_1d(np.asarray(pressure, float))
    require_nonnegative(pressure=pressure)
    layer = column_layer((Column(1.0, material.fed_density_ratio),), material, 1.0, PLATE)
    y, error_scale, rows = layer.initial_state, layer.error_scale(layer.max_indentation, INTEGRATION_RTOL), []
    for stress in pressure.tolist():
        coordinate_end = -1.0 if stress > y[STRESS] else 1.0
        path, layer, _ = layer.integrate(0.0, y, PathControl(coordinate_end, stress, error_scale, np.inf))
        y = path[-1, 1:]
        strain, lateral_stress = 1 - layer.heights(y)[0], 1.5 * y[COLUMN_STATE] - stress / 2
        if not strain < 1 - material.fed_density_ratio:
            raise ValueError(f"`pressure` must be less than the stress that closes all pores, got {stress!r} Pa")
        rows.append((stress, strain, lateral_stress, layer.density_ratios(y)[0]))
    return OedometerResult(*np.array(rows).T)


def _sampled_pass(layer: ColumnLayer, name: str, value: float, rtol: float) -> Contact:
    """Compute the pass with a prescribed quantity and its pressure at many points."""

    def compute(indentation: float) -> Contact:
        return layer.compute_pass(indentation, rtol, column_pass.SAMPLED_STEP_SHARE)

    return column_pass.solve_target(layer, compute, name, value, column_pass.SEARCH_TOLERANCE * rtol)


def _require_compaction(material: object) -> None:
    if not isinstance(material, Compaction):
        raise ValueError(
            f"the engine column needs a `material` Compaction or StateUpdate, got {type(material).__name__}; "
            "use the engine spectral or fem"
        )
