"""Figures of the sizing: peaks over the duration of a pass with their crossovers, and torque of a uniform shaft."""

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from compact.analysis.sizing.durations import DurationStudy
from compact.analysis.sizing.machine_sizing import LawSizing
from compact.machine.motor_sizing import SizingRule
from compact.quantities import CRITERIA
from compact.report.figures.style import PALETTE, label_decades, law_style, panels, write_none_finite

PANEL = (5.2, 3.4)  # [inch]
OTHERS: dict[str, Any] = {"color": "0.82", "linewidth": 0.8}
FIRST_WIDTH = 2.2  # [pt]
SHAFT_PANEL = (7.2, 3.0)  # [inch]
LIMITS = ("rated", "peak")  # of the motor, drawn below the torques of the shaft
QUARTER = 90  # [degrees], between ticks
LEVELS: dict[str, tuple[str, Any]] = {  # colour and dash
    "rms": (PALETTE[0], "--"), "mean": ("0.45", ":"), "rated": (PALETTE[1], "-."), "peak": (PALETTE[1], (0, (8, 2))),
}  # fmt: skip


def draw_durations(found: DurationStudy, own_duration: float) -> Figure:
    """Draw peak force and peak power over the duration.

    Parameters
    ----------
    found : DurationStudy
        Ranking over the duration.
    own_duration : float
        Duration of the scene [s], marked where it is within the range.
    """
    figure, axes = panels(1, len(found.orders), PANEL, bottom=0.6, gaps=(0.85, 0.3))
    for ax, by in zip(axes[0], found.orders, strict=True):
        _draw_peak(ax, found, by)
        if found.durations[0] <= own_duration <= found.durations[-1]:
            ax.axvline(own_duration, color="0.6", linewidth=0.8, linestyle=":", zorder=0)
            ax.annotate("scene", (own_duration, 0.02), (-3, 0), xycoords=("data", "axes fraction"), color="0.4",
                        textcoords="offset points", ha="right", fontsize="small")  # fmt: skip
    return figure


def _draw_peak(ax: Axes, found: DurationStudy, by: str) -> None:
    """Draw one peak: the laws, the first ones where they are first, and the crossovers."""
    quantity = CRITERIA[by]
    factor, times, peaks = quantity.plot_factor, np.array(found.durations), found.values(by)
    ax.set(xlabel="duration of a pass T [s]", ylabel=quantity.axis_label)
    if not np.isfinite(list(peaks.values())).any():
        write_none_finite(ax, by)
        return
    for values in peaks.values():
        ax.plot(times, np.where(np.isfinite(values), values, np.nan) * factor, **OTHERS)
    ax.set(xscale="log", yscale="log")
    for law, low, high in found.segments(by):
        grid = np.unique(np.concatenate([[low, high], times[(times > low) & (times < high)]]))
        line = np.exp(np.interp(np.log(grid), np.log(times), np.log(peaks[law])))
        for cross in found.crossovers:
            if cross.by == by:
                line = np.where(np.isclose(grid, cross.duration), cross.value, line)
        ax.plot(grid, line * factor, **law_style(law) | {"linewidth": FIRST_WIDTH, "label": law})
    for cross in (each for each in found.crossovers if each.by == by):
        ax.plot(cross.duration, cross.value * factor, "o", color="black", markersize=4, zorder=3)
        ax.annotate(f"{cross.duration:.3g} s", (cross.duration, cross.value * factor), (4, 4),
                    textcoords="offset points", fontsize="small")  # fmt: skip
    label_decades(ax.xaxis, times[0], times[-1])
    label_decades(ax.yaxis, *ax.get_ylim())
    ax.set_xlim(times[0], times[-1])
    ax.grid(color="0.93")
    if found.segments(by):
        ax.legend(loc="upper right", fontsize="small", title="first law", title_fontsize="small")


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
    figure, axes = panels(1, 1, SHAFT_PANEL, right=1.6, bottom=0.6)
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
