"""Figures of the first screen: resistance over speed by all models with their bands, and the cycle of the best laws.

Each function draws one figure from finished results and returns it. Curves differ by dash and width as well, so that
the figures can be read in grey.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from compact.analysis.stages.verdict import ModelAnswer
from compact.quantities import MOTION, SPEED, TIME
from compact.report.figures.ranking import engine_style
from compact.report.figures.style import law_style, panels

SIZE = (5.0, 3.2)  # [inch], of the panels; two figures lie next to one another on a screen of 1280 px
CYCLE_SIZE = (5.0, 1.5)  # [inch], of each panel of the cycle
BAND_SHADE = 0.18  # [-], opacity of a band
LEAST_BAND = 0.01  # [-], relative half-width of a band that is drawn
BEST_LAWS = 3  # [-], laws of the second figure
BEST_DASHES: tuple[Any, ...] = ("-", (0, (6, 2)), (0, (1, 1.4)))
BEST_WIDTHS = (2.4, 1.9, 2.2)  # [points]
ROW = 0.07  # [-], of the height of the panel, between the names of laws
POINTS = 401  # [-], of a curve


def draw_models(models: Sequence[ModelAnswer], resistances: Mapping[str, Any], speeds: Mapping[str, float]) -> Figure:
    """Draw the resistance of one cart over its speed by all models.

    Parameters
    ----------
    models : sequence of ModelAnswer
        Answers, that of the engine of the scene first. Its band is the spread over the laws of the mix, that of the
        others the error estimate.
    resistances : mapping of str to callable
        Resistance [N] of velocity [m/s] and acceleration [m/s2] by engine.
    speeds : mapping of str to float
        Largest speed of each law that is marked [m/s].
    """
    figure, ((ax,),) = panels(1, 1, SIZE, top=0.3)
    fastest = 1.08 * max(speeds.values())
    largest = 0.0
    for number, model in enumerate(models):
        force = resistances[model.engine]
        limit = min(fastest, float(getattr(force, "speeds", [fastest])[-1]))
        speed = np.linspace(0, limit, POINTS)[1:]
        values = np.asarray(force(speed, np.zeros_like(speed))) / 1e3
        color, _, dash = engine_style(model.engine)
        label = model.engine if model.valid else f"{model.engine}, not for sizing"
        width = 3.0 if number == 0 else 1.7
        ax.plot(speed, values, linestyle=dash, color=color, linewidth=width, label=label, zorder=3 if number else 2.5)
        low, high = model.spread or (1 - (model.error or 0.0), 1 + (model.error or 0.0))
        if max(1 - low, high - 1) > LEAST_BAND:
            words = "laws of the mix" if model.spread else f"error, {model.engine}"
            ax.fill_between(speed, low * values, high * values, color=color, alpha=BAND_SHADE, linewidth=0, label=words)
        largest = max(largest, float(max(high, 1.0) * values.max()))
    _mark_speeds(ax, speeds)
    ax.set(xlabel=SPEED.axis_label, ylabel=MOTION["cart_resistance"].axis_label)
    ax.set(xlim=(0, fastest), ylim=(0, 1.5 * largest))
    ax.spines[["top", "right"]].set_visible(False)
    ax.set_title("Resistance of one cart by all models", fontsize=10, loc="left", fontweight="bold")
    ax.legend(frameon=False, fontsize=8, ncols=2, handlelength=3.2, loc="upper left", labelspacing=0.3)
    return figure


def _mark_speeds(ax: Any, speeds: Mapping[str, float]) -> None:
    """Mark the largest speeds of laws at the axis of the speed, each with its name."""
    style: dict[str, Any] = {"color": "0.45", "linewidth": 0.8, "linestyle": (0, (2, 2)), "zorder": 1}
    for row, (name, speed) in enumerate(sorted(speeds.items(), key=lambda each: each[1])):
        height = 0.36 - ROW * (row % 4)
        ax.axvline(speed, ymax=height + 0.02, **style)
        ax.annotate(
            name, (speed, height), xycoords=("data", "axes fraction"), xytext=(-3, 0), textcoords="offset points",
            ha="right", va="center", fontsize=7.5, color="0.2",
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.6},
        )  # fmt: skip


def draw_best_cycles(runs: Mapping[str, Any]) -> Figure:
    """Draw drive force, positive along the motion, and power of the best laws over a cycle.

    Parameters
    ----------
    runs : mapping
        Run of each law, at most BEST_LAWS of them.
    """
    figure, axes = panels(2, 1, CYCLE_SIZE, top=0.3, gaps=(0.0, 0.2), sharex=True)
    force, power = axes[:, 0]
    for (name, run), dash, width in zip(runs.items(), BEST_DASHES, BEST_WIDTHS, strict=False):
        style = {"color": law_style(name)["color"], "linestyle": dash, "linewidth": width, "label": name}
        force.plot(run.time, run.direction * run.drive_force / 1e3, **style)
        power.plot(run.time, run.drive_power, **style)
    for ax in (force, power):
        ax.axhline(0, color="0.7", linewidth=0.8, zorder=0)
        ax.margins(x=0)
        ax.spines[["top", "right"]].set_visible(False)
    force.set_ylabel("force [kN]", fontsize=9)
    power.set_ylabel("power [W]", fontsize=9)
    power.set_xlabel(TIME.axis_label)
    force.set_title("Force and power over a cycle, best laws", fontsize=10, loc="left", fontweight="bold")
    low, high = force.get_ylim()
    force.set_ylim(low, high + 0.3 * (high - low))
    force.legend(frameon=False, fontsize=8, ncols=BEST_LAWS, loc="upper center", handlelength=3.4)
    return figure
