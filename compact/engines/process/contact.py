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

from typing import Any

import numpy as np

from compact.engines.column.column_pass import Column, Columns
from compact.rolling_contact import Contact


def process_contact(study: Any, speed: float) -> Contact:
    """Compute the forces of the strokes under one roller at a speed of the cart.

    Parameters
    ----------
    study : analysis.process.ProcessStudy
        Forming process at the mean speed.
    speed : float
        Speed of the cart [m/s].

    Returns
    -------
    Contact
        Of all strokes under a roller in a forward stroke, means over the roller length: the indentation is the mean
        bite, the edges are weighted by the load of the strokes, the exit is the product.

    Raises
    ------
    ValueError
        If the feed closes all pores at this speed, or the roller does not draw the mix in.
    """
    forces = study.forces_at(abs(speed))
    row, found, length = forces.row, forces.found, study.problem.machine.roller_length
    history, weights = row.history, row.history.load * row.lengths
    weights = weights / weights.sum() if weights.any() else np.full(len(weights), 1 / len(weights))
    columns, peak, residual = history.states[-1].columns, row.peak_pressure, 0.0
    if found is not None:
        columns = tuple(Column(*each) for each in found.lumpings[0].profile_at(row.product_density_ratio).T.tolist())
        peak = found.rate_scale * found.of_product("peak_pressure")
        residual = max(sequence.largest_work_residual for sequence in found.sequences)
    return Contact(
        load=forces.load / length,
        resistance=float(np.copysign(forces.resistance, speed)) / length,
        leading=float(weights @ history.leading),
        trailing=float(weights @ history.trailing),
        error=forces.errors,
        work_residual=max(history.work_residual, residual),
        peak_pressure=peak,
        indentation=float(weights @ np.maximum(history.bite, 0.0)),
        exit_height=row.product_height,
        exit_density_ratio=row.product_density_ratio,
        mass_residual=history.mass_residual,
        speed=speed,
        exit=Columns(columns),
    )  # fmt: skip
