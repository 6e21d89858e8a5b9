"""Figures of the laws and the machine: kinematics, drive force and power, guide reactions, cams and crankshaft.

Each function draws one figure from finished results and returns it; a law has the same colour and dash in all of them.
"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise, zip_longest
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from compact.cams.profile import Cam
from compact.machine.crankshaft import CrankshaftRevolution
from compact.motion.profile import Cycle
from compact.quantities import CRITERIA, MOTION, TIME
from compact.report.figures.style import DASHES, FAMILIES, PALETTE, TITLE_HEIGHT, law_style, legend_below, panels

CROP_RATIO = 3.0  # [-], limit of a figure of drives over the median of the peaks
SHADED = "0.92"  # grey of the panel of an undercut cam
POINTS_OF_A_LAW = 400  # [-]
FIRST_LINE_WIDTH = 2.8  # [points]; the first line of a panel is the broadest, so that no line hides another
LINE_RATIO = 0.87  # [-], width of a line over that of the line before


def _families(names: Iterable[str]) -> dict[str, list[str]]:
    """Group laws by family; laws outside FAMILIES join the machines and tables."""
    names = list(names)
    known = {name for members in FAMILIES.values() for name in members}
    groups = {family: [n for n in members if n in names] for family, members in FAMILIES.items()}
    groups["machines and tables"] += [name for name in names if name not in known]
    return {family: members for family, members in groups.items() if members}


def _grid(families: Mapping[str, Any], columns: Sequence[str], width: float = 3.6) -> tuple[Figure, NDArray[Any]]:
    size = (width, 2.0)
    figure, axes = panels(len(families), len(columns), size, right=2.6, top=0.35, sharex=True, sharey="col")
    for ax, column in zip(axes[0], columns, strict=True):
        ax.set_title(MOTION[column].axis_label, fontsize=11, y=TITLE_HEIGHT)
    for ax in axes.ravel():
        ax.axhline(0, color="0.8", linewidth=0.8, zorder=0)
        ax.margins(x=0)
        ax.locator_params(axis="y", nbins=4)  # labels take most of the time of a figure
    for ax, family in zip(axes[:, 0], families, strict=True):
        ax.set_ylabel(family, fontsize=10)
    for ax in axes[-1]:
        ax.set_xlabel(TIME.axis_label)
    return figure, axes


def _plot_law(ax: Axes, name: str, time: NDArray[np.float64], values: NDArray[np.float64], impulsive: bool) -> None:
    label = f"{name} (velocity jumps)" if impulsive else name
    width = FIRST_LINE_WIDTH * LINE_RATIO ** len(ax.lines)
    ax.plot(time, values, linewidth=width, label=label, **law_style(name))


def _legends(axes: NDArray[Any]) -> None:
    for ax in axes[:, -1]:
        ax.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.02, 0.5), frameon=False, handlelength=3.2)


def draw_kinematics(cycles: Mapping[str, Cycle]) -> Figure:
    """Draw velocity, acceleration and jerk of every law over the forward stroke, as the law prescribes them."""
    families = _families(cycles)
    figure, axes = _grid(families, ("velocity", "acceleration", "jerk"))
    for row, members in zip(axes, families.values(), strict=True):
        for name in members:
            forward: Any = cycles[name].forward
            phase = _phases(forward.curve.x)
            impulsive = any(join.order == 1 for join in forward.discontinuities())
            for ax, order in zip(row, (1, 2, 3), strict=True):
                _plot_law(ax, name, phase * forward.duration, forward.at_phase(phase, order), impulsive)
    _legends(axes)
    return figure


def _phases(joined: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return phases on both sides of every join, so that discontinuities are drawn upright."""
    count = max(3, POINTS_OF_A_LAW // (len(joined) - 1))
    return np.concatenate(
        [np.linspace(np.nextafter(low, 2.0), np.nextafter(high, -1.0), count) for low, high in pairwise(joined)]
    )


def draw_drive(runs: Mapping[str, Any]) -> Figure:
    """Draw drive force, positive along the motion, and power of every law over a cycle."""
    families = _families(runs)
    figure, axes = _grid(families, ("drive_force", "drive_power"), width=4.6)
    for row, members in zip(axes, families.values(), strict=True):
        for name in members:
            run = runs[name]
            _plot_law(row[0], name, run.time, run.direction * run.drive_force / 1e3, run.impulses)
            _plot_law(row[1], name, run.time, run.drive_power, run.impulses)
    for column, by in zip(axes.T, ("peak_force", "peak_power"), strict=True):
        quantity = CRITERIA[by]
        peaks = {name: getattr(run, by) * quantity.plot_factor for name, run in runs.items()}
        _crop(column[0], peaks.values())
        for ax, members in zip(column, families.values(), strict=True):
            _name_cropped(ax, {name: peaks[name] for name in members}, quantity.shown_unit)
    _legends(axes)
    return figure


def _crop(ax: Axes, peaks: Iterable[float]) -> None:
    """Limit an axis to a multiple of the median peak, as a few laws exceed it many times."""
    finite = [peak for peak in peaks if np.isfinite(peak)]
    most = CROP_RATIO * np.median(finite) if finite else np.inf
    low, high = ax.get_ylim()
    ax.set_ylim(max(low, -most), min(high, most))


def _three_digits(value: float) -> str:
    """Format a number to three digits without an exponent below a million.

    >>> _three_digits(7.519), _three_digits(1002.6)
    ('7.52', '1003')
    """
    return f"{value:.3g}" if abs(value) < 100 else f"{value:.0f}"


def _name_cropped(ax: Axes, peaks: Mapping[str, float], unit: str) -> None:
    """Name the laws beyond the scale of a panel with their peaks."""
    limit = max(map(abs, ax.get_ylim()))
    labels = [
        f"▲ {name}: peak {_three_digits(peak)} {unit}, off the scale"
        if np.isfinite(peak)
        else f"▲ {name}: infinite at its jumps"
        for name, peak in peaks.items()
        if peak > limit
    ]
    if labels:
        ax.text(
            0.03, 0.05, "\n".join(labels), transform=ax.transAxes, ha="left", va="bottom", fontsize=8,
            bbox={"facecolor": "white", "edgecolor": "0.6", "pad": 2},
        )  # fmt: skip


def draw_reactions(runs: Mapping[str, Any], names: Sequence[str]) -> Figure:
    """Draw the guide-wheel reactions over a cycle; below zero a wheel runs on the lower rail."""
    figure, (axes,) = panels(1, len(names), (5.2, 2.5), bottom=0.85, top=0.3, gaps=(0.3, 0.0), sharey=True)
    for ax, name in zip(axes, names, strict=True):
        run = runs[name]
        front, rear = run.state.forces.front_reaction / 1e3, run.state.forces.rear_reaction / 1e3
        lowest = min(front.min(), rear.min())
        ax.plot(run.time, front, color=PALETTE[0], label="front wheel N₁")
        ax.plot(run.time, rear, color=PALETTE[1], linestyle="--", label="rear wheel N₂")
        if lowest < 0:
            ax.axhspan(lowest, 0, color="0.92", zorder=0, label="lifted off: on the lower rail")
        ax.axhline(0, color="0.6", linewidth=0.8)
        ax.set_title(name, y=TITLE_HEIGHT)
        ax.set_xlabel(TIME.axis_label)
        ax.margins(x=0)
    axes[0].set_ylabel(MOTION["guide_reaction"].axis_label)
    legend_below(figure, axes[-1], columns=3)
    return figure


def draw_cams(cams: Mapping[tuple[str, str], Cam], names: Sequence[str], follower: str) -> Figure:
    """Draw the cam profiles for one follower with the path of the roller centre, a panel for each law.

    Returns
    -------
    Figure
        The panel of an undercut cam is shaded and labelled.
    """
    columns = min(7, len(names))
    rows = -(-len(names) // columns)
    figure, axes = panels(rows, columns, (1.6, 1.8), top=0.45, gaps=(0.45, 0.5), sharex=True, sharey=True)
    phi = np.linspace(0, 2 * np.pi, 2001)
    for ax, name in zip_longest(axes.ravel(), names):
        ax.set_visible(name is not None)
        if name is None:
            continue
        cam = cams[name, follower]
        radius = cam.radius(phi)
        ax.plot(*cam.profile(phi), color=law_style(name)["color"], linewidth=1.6)
        ax.plot(radius * np.cos(phi), radius * np.sin(phi), color="0.6", linewidth=0.7, linestyle="--")
        ax.plot(0, 0, "k+", markersize=6)
        ax.set_title(name + ("\nUNDERCUT" if cam.undercut else "\n"), fontsize=8, y=TITLE_HEIGHT)
        if cam.undercut:
            ax.set_facecolor(SHADED)
        ax.set_aspect("equal")
        ax.tick_params(labelsize=7)
    figure.supxlabel("x [m]", fontsize=9)
    figure.supylabel("y [m]", fontsize=9)
    return figure


def draw_crank_turns(turns: Mapping[str, CrankshaftRevolution]) -> Figure:
    """Draw torque and power of the shaft over a turn for 1 to 4 carts, with thin lines of the means."""
    figure, (both,) = panels(1, 2, (4.4, 2.9), bottom=0.85)
    shafts = [key for key in turns if key.isdigit()]
    for key, color, dash in zip(shafts, colormaps["viridis"](np.linspace(0, 0.85, len(shafts))), DASHES, strict=False):
        turn = turns[key]
        label = f"{key} cart{'s' if key != '1' else ''}"
        for ax, values in zip(both, (turn.torque, turn.power), strict=True):
            ax.plot(np.degrees(turn.angle), values / 1e3, color=color, linestyle=dash, label=label)
            ax.axhline(turn.mean(values) / 1e3, color=color, linestyle=dash, linewidth=0.7)
    for ax, name in zip(both, ("shaft_torque", "shaft_power"), strict=True):
        ax.set(xlabel=MOTION["crank_angle"].axis_label, ylabel=MOTION[name].axis_label, xticks=range(0, 361, 45))
        ax.margins(x=0)
    legend_below(figure, both[0], columns=4)
    return figure
