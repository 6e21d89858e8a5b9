"""Figure of the torque of a uniform shaft over a revolution, with its mean, its rms and the limits of the motor."""

import math

import numpy as np
from matplotlib.figure import Figure

from compact.analysis.sizing.machine_sizing import LawSizing
from compact.machine.motor_sizing import SizingRule
from compact.report.figures.style import PALETTE, panels

PANEL = (7.2, 3.0)  # [inch]
LIMITS = ("rated", "peak")  # of the motor, drawn below the torques of the shaft
QUARTER = 90  # [degrees], between ticks
LEVELS = {"rms": (PALETTE[0], "--"), "mean": ("0.45", "--"), "rated": (PALETTE[1], "-"), "peak": (PALETTE[1], ":")}


def draw_shaft_torque(sizing: LawSizing, rule: SizingRule) -> Figure:
    """Draw the torque of all carts over the angle of the shaft.

    Parameters
    ----------
    sizing : LawSizing
        Requirement of a law, with the motor of the catalogue if there is one.
    rule : SizingRule
        Rule by which the motor holds; its torques are shown at the shaft, divided by the margin.
    """
    found = sizing.requirement
    assert found is not None  # a law with finite torque
    figure, axes = panels(1, 1, PANEL, right=1.6, bottom=0.6)
    ax = axes[0, 0]
    ax.plot(np.degrees(found.angle), found.torque, color="black", linewidth=1.6, label=sizing.law)
    levels = {"rms": (found.rms_torque, "rms torque"), "mean": (found.mean_torque, "mean torque")}
    chosen = None if sizing.choice is None else sizing.choice.chosen
    if chosen is not None:
        at_shaft = chosen.gear_ratio * rule.efficiency / rule.margin
        levels["rated"] = chosen.motor.rated_torque * at_shaft, f"rated, {chosen.motor.name}"
        levels["peak"] = chosen.motor.peak_torque * at_shaft, f"peak, {chosen.motor.name}"
    for name, (value, label) in levels.items():
        colour, line = LEVELS[name]
        ax.axhline(value, color=colour, linestyle=line, linewidth=1.4, label=label, zorder=3 - (name in LIMITS))
    ax.axhline(0.0, color="0.7", linewidth=0.8)
    ax.set_xticks(range(0, math.ceil(math.degrees(2 * math.pi)) + 1, QUARTER))
    ax.set(xlabel="angle of the shaft [°]", ylabel="torque of the shaft [N m]", xlim=(0, 360))
    ax.grid(color="0.93")
    ax.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False, fontsize="small")
    return figure
