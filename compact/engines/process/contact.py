"""Forming process as the engine "process": forces of all strokes under one roller as those of one contact.

    F(v) = n F_row(v) + F_s

is the resistance of the mix to one cart of n rollers at the speed v, with the drag F_s of the feed sleeves. Guide
wheels are part of the cart, as with every engine. Over a stroke F depends on the speed alone:

    rate         the yield pressure follows the speed of the cart where it passes a section, by the rate factor
    pore air     its forces are in proportion to the speed, where `mix.pore_air` counts them
    acceleration does not enter: the mix has no memory in time
    position     does not enter: every section along the travel has had the same strokes. The overlap of two rollers,
                 3 % of the stroke in the published machine, is met by both; the mean force is also the largest one
    duration     at a given speed of the mould, F grows with the time of a stroke, in which the mould brings more mix:
                 each duration of a pass has a map of its own (`ResistanceStage.over`)

The forces are per unit roller length, means over the roller. The load depends on the position along the roller, which
a drive along the travel does not meet.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from compact.rolling_contact import ContactResult

NO_PROFILE = np.empty(0)  # the strokes under a roller have no common pressure along the contact


class ProductRow(NamedTuple):
    """Row of the product.

    Parameters
    ----------
    height : float
        Height [m].
    density_ratio : float
        Density ratio [-], above 1 where the law of the mix is left.
    """

    height: float
    density_ratio: float


@dataclass(frozen=True, kw_only=True)
class ProcessContactResult(ContactResult):
    """`ContactResult` of all strokes under a roller in a forward stroke, means over the roller length.

    Edges are means weighted by the load of the strokes.

    Parameters
    ----------
    indentation : float
        Mean bite [m].
    exit_height : float
        Height of the product [m].
    exit_density_ratio : float
        Mean density ratio of the product [-].
    mass_residual : float
        Grains of the product over those of fill and feed, less 1 [-].
    speed : float
        Speed of the cart [m/s].
    columns, lower_columns : tuple of ProductRow
        Rows of the product from the base upwards; no lower lift.
    """

    indentation: float
    exit_height: float
    exit_density_ratio: float
    mass_residual: float
    speed: float
    columns: tuple[ProductRow, ...]
    lower_columns: tuple[ProductRow, ...] = ()


def process_contact(study: Any, speed: float) -> ProcessContactResult:
    """Compute the forces of the strokes under one roller at a speed of the cart.

    Parameters
    ----------
    study : analysis.process.ProcessStudy
        Forming process at the mean speed.
    speed : float
        Speed of the cart [m/s].

    Returns
    -------
    ProcessContactResult

    Raises
    ------
    ValueError
        If the feed closes all pores at this speed, or the roller does not draw the mix in.
    """
    forces = study.forces_at(abs(speed))
    row, found, length = forces.row, forces.found, study.problem.machine.roller_length
    history, weights = row.history, row.history.load * row.lengths
    weights = weights / weights.sum() if weights.any() else np.full(len(weights), 1 / len(weights))
    if found is None:
        columns = tuple(ProductRow(each.height, each.density_ratio) for each in history.states[-1].columns)
        peak, residual = row.peak_pressure, 0.0
    else:
        heights, ratios, _ = found.lumpings[0].profile_at(row.product_density_ratio).tolist()
        columns = tuple(map(ProductRow, heights, ratios))
        peak = found.rate_scale * found.of_product("peak_pressure")
        residual = max(sequence.largest_work_residual for sequence in found.sequences)
    return ProcessContactResult(
        load=forces.load / length,
        resistance=float(np.copysign(forces.resistance, speed)) / length,
        leading=float(weights @ history.leading),
        trailing=float(weights @ history.trailing),
        x=NO_PROFILE, pressure=NO_PROFILE, shear_traction=NO_PROFILE,
        error=forces.errors,
        work_residual=max(history.work_residual, residual),
        peak_pressure=peak,
        indentation=float(weights @ np.maximum(history.bite, 0.0)),
        exit_height=row.product_height,
        exit_density_ratio=row.product_density_ratio,
        mass_residual=history.mass_residual,
        speed=speed,
        columns=columns,
    )  # fmt: skip
