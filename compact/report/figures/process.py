"""Figures of a forming process: section through mould and roller, strokes on a section, and map over both speeds.

Each function draws one figure from a finished study and returns it.
"""

from collections.abc import Iterator
from typing import Literal

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from compact.analysis.process import ProcessStudy
from compact.engines.process.fields import section_rows
from compact.engines.process.lifts import TwoDimensionalRow
from compact.engines.process.section import SectionState
from compact.quantities import STROKE
from compact.report.figures.style import PALETTE, panels
from compact.report.figures.sweep import label_contours

SECTION_COLOURS = "cividis_r"  # loose mix is light, dense mix is dark
SLOPE_ANGLE = 35.0  # [deg], of the loose mix at the empty mould, as drawn
PRODUCT_SHARE = 0.3  # [-], length of the product shown behind the roller over that of the roller
DECORATION_SHARE = 0.17  # [-], of the roller length, least height to which words and arrows are in proportion
PANEL_HEIGHT = 1.25  # [inch], of load, resistance and density along the roller
HEADROOM = 1.1  # [-], of an axis over the largest value
STEEL, STEEL_EDGE = "0.88", "0.35"
MINUTE = 60.0  # [s]


def draw_section(study: ProcessStudy) -> Figure:
    """Draw the section through mould and roller with the density in colour, and load, resistance and density."""
    row, machine = study.row, study.problem.machine
    height, length = machine.height, machine.roller_length
    tail = PRODUCT_SHARE * length
    slope = study.problem.fill.height / np.tan(np.radians(SLOPE_ANGLE))
    span = (-slope - 0.12 * length, length + tail)
    unit = max(height, DECORATION_SHARE * length)  # of words and arrows, readable above a thin product too
    top = height + 2 * machine.roller_radius + 0.5 * unit
    scale = 10.0 / (span[1] - span[0])  # [inch/m]
    heights = ((top + 0.32 * unit) * scale, *(PANEL_HEIGHT,) * 3)
    figure = Figure(figsize=(11.6, sum(heights) + 2.25))
    width, total = figure.get_size_inches()
    lowest = [0.6 + place * (PANEL_HEIGHT + 0.25) for place in (2, 1, 0)]
    bottoms = (lowest[0] + PANEL_HEIGHT + 0.35, *lowest)
    axes = [
        figure.add_axes((0.8 / width, bottom / total, 10.0 / width, tall / total))
        for bottom, tall in zip(bottoms, heights, strict=True)
    ]
    norm = Normalize(min(study.problem.fill.density_ratio, study.problem.feed.density_ratio), 1.0)
    _draw_mix(axes[0], study, norm, slope, tail)
    _draw_machine(axes[0], study, span, slope, unit)
    axes[0].set(xlim=span, ylim=(-0.32 * unit, top))
    axes[0].set_aspect("equal")
    axes[0].axis("off")
    bar = figure.add_axes((0.8 / width, (total - 0.55) / total, 3.2 / width, 0.16 / total))
    beyond: Literal["max", "neither"] = "neither" if study.two_dimensions is None else "max"
    colours = ScalarMappable(norm, colormaps[SECTION_COLOURS])
    figure.colorbar(colours, cax=bar, orientation="horizontal", extend=beyond)
    bar.set_title("density ratio k: left loose, right without pores", fontsize=9, loc="left")
    edges, history = row.edges, row.history
    load = study.forces.of_strokes("load")
    for ax, forces, colour in (
        (axes[1], load / 1e3, PALETTE[0]),
        (axes[2], study.forces.of_strokes("resistance"), "0.2"),
    ):
        ax.stairs(forces, edges, color=colour, fill=True, alpha=0.35)
        ax.stairs(forces, edges, color=colour)
    centre = row.centre_of(load)
    axes[1].axvline(centre, color=PALETTE[1], linestyle="--")
    share = centre / length
    axes[1].text(
        centre - 0.01 * length, 0.9, f"centre of the load, {share:.0%} of the roller", color=PALETTE[1],
        transform=axes[1].get_xaxis_transform(), ha="right", va="top", fontsize=9,
    )  # fmt: skip
    axes[1].set(ylim=(0, None), ylabel="load P\n[kN/m]")
    axes[2].set(ylim=(0, None), ylabel="resistance F\n[N/m]")
    axes[3].stairs(history.density_ratio, edges, baseline=None, color=PALETTE[2])
    axes[3].axhline(row.required_density_ratio, color="0.4", linestyle=":")
    axes[3].text(span[0], row.required_density_ratio, " required", color="0.3", va="top", fontsize=9)
    axes[3].set(ylabel="mean density\nratio k [-]", xlabel=f"{STROKE['position'].axis_label}")
    for ax in axes[1:]:
        ax.set_xlim(span)
        ax.tick_params(labelbottom=ax is axes[-1])
    return figure


def _draw_mix(ax: Axes, study: ProcessStudy, norm: Normalize, slope: float, tail: float) -> None:
    """Draw the slope of loose mix, every section under the roller, and the product."""
    row, fill = study.row, study.problem.fill
    states, edges = row.history.states, row.edges
    pieces = [
        (low, high, state) for low, high, state in zip(edges[:-1], edges[1:], states[1:], strict=True) if high > low
    ]
    length = study.problem.machine.roller_length
    if study.problem.machine.strokes is None:
        pieces.append((length, length + tail, states[-1]))
    outlines = [[(-slope, 0.0), (0.0, 0.0), (0.0, fill.height)]]
    ratios = [fill.density_ratio]
    for low, high, state in pieces:
        bottom = 0.0
        for height, ratio in _rows(study, state):
            upper = bottom + height
            outlines.append([(low, bottom), (high, bottom), (high, upper), (low, upper)])
            ratios.append(ratio)
            bottom = upper
    colours = colormaps[SECTION_COLOURS](norm(ratios))
    ax.add_collection(PolyCollection(outlines, facecolors=colours, edgecolors=colours, linewidths=0.2))


def _rows(study: ProcessStudy, state: SectionState) -> Iterator[tuple[float, float]]:
    """Yield heights and density ratios of a section."""
    found = study.two_dimensions
    lifts = None if found is None else found.lumpings[0]
    yield from ((height, ratio) for height, ratio, _ in section_rows(state, lifts))


def _draw_machine(ax: Axes, study: ProcessStudy, span: tuple[float, float], slope: float, unit: float) -> None:
    """Draw mould, roller and arrows with their words."""
    machine, row = study.problem.machine, study.row
    h, R, L = machine.height, machine.roller_radius, machine.roller_length
    ax.add_patch(
        Rectangle((span[0], -0.12 * unit), span[1] - span[0], 0.12 * unit, facecolor=STEEL, edgecolor=STEEL_EDGE)
    )
    ax.text(span[0] + 0.01 * L, -0.06 * unit, "mould", fontsize=8, va="center")
    ax.add_patch(Rectangle((0, h), L, 2 * R, facecolor=STEEL, edgecolor=STEEL_EDGE))
    ax.plot([-0.03 * L, 1.03 * L], [h + R, h + R], color=STEEL_EDGE, linewidth=0.8, linestyle="-.")
    strokes = machine.strokes_on_section
    ax.text(
        L / 2, h + 1.45 * R, f"roller, {L:.3g} m long, rolls across the picture\nat {machine.cart_speed:.3g} m/s",
        ha="center", va="center", fontsize=10,
    )  # fmt: skip
    ax.text(L / 2, h + 0.5 * R, f"{strokes:.3g} strokes on every section", ha="center", va="center", fontsize=10)
    arrow = {"arrowstyle": "-|>", "color": PALETTE[1], "linewidth": 1.6}
    fed = row.history.make_up
    for place in np.linspace(0.08, 0.92, 8) * L:
        stroke = min(int(np.searchsorted(row.edges, place, side="right")) - 1, len(fed) - 1)
        if fed[stroke] > 0:
            ax.annotate("", (place, h + 2 * R + 0.03 * unit), (place, h + 2 * R + 0.3 * unit), arrowprops=arrow)
    makeup = f"{fed[fed > 0].min() * 1e3:.2g} to {fed.max() * 1e3:.2g} mm" if fed.any() else "none"
    ax.text(
        L, h + 2 * R + 0.34 * unit, f"mix fed before each stroke: {makeup}", ha="right", va="bottom", color=PALETTE[1]
    )
    ax.text(-slope, h / 2 + 0.05 * unit, "loose mix\nslides in", ha="center", va="bottom", fontsize=9)
    if machine.strokes is None:
        behind = L + PRODUCT_SHARE * L / 2
        words = f"product\n{row.product_height * 1e3:.1f} mm\nk = {row.product_density_ratio:.3f}"
        ax.text(behind, h + 0.08 * unit, words, ha="center", va="bottom", fontsize=10)
        speed = f"mould moves at {machine.mould_speed * MINUTE:.3g} m/min, {machine.advance * 1e3:.3g} mm per stroke"
        ax.annotate("", (L * 0.72, -0.22 * unit), (L * 0.62, -0.22 * unit), arrowprops=arrow)
        ax.text(L * 0.6, -0.22 * unit, speed, ha="right", va="center", color=PALETTE[1])
    else:
        ax.text(L * 0.5, -0.22 * unit, "mould at rest", ha="center", va="center", color=PALETTE[1])


def draw_strokes(study: ProcessStudy) -> Figure:
    """Draw bite, make-up, peak pressure and density of the strokes on one section."""
    history, machine = study.row.history, study.problem.machine
    figure, axes = panels(1, 3, (3.6, 2.7), gaps=(0.85, 0.3), top=0.3)
    number = np.arange(1, history.count + 1)
    style = {"where": "mid"} if history.count > 1 else {"where": "mid", "marker": "o"}
    axes[0, 0].step(number, history.bite * 1e3, color=PALETTE[0], label="bite: surface above the generatrix", **style)
    axes[0, 0].step(number, history.make_up * 1e3, color=PALETTE[1], label="make-up: mix fed", **style)
    if HEADROOM * history.bite.max() > machine.max_bite:
        axes[0, 0].axhline(machine.max_bite * 1e3, color="0.4", linestyle=":", label="bite at the nip angle")
    axes[0, 0].set(xlabel="stroke on a section", ylabel="height [mm]", ylim=(0, HEADROOM * 1e3 * history.bite.max()))
    axes[0, 0].legend(frameon=False, fontsize=8)
    axes[0, 1].step(number, history.peak_pressure / 1e3, color=PALETTE[0], **style)
    axes[0, 1].set(xlabel="stroke on a section", ylabel=STROKE["peak_pressure"].axis_label, ylim=(0, None))
    axes[0, 2].plot([0, *number], [history.states[0].density_ratio, *history.density_ratio], color=PALETTE[2])
    axes[0, 2].axhline(study.row.required_density_ratio, color="0.4", linestyle=":", label="required")
    axes[0, 2].set(xlabel="stroke on a section", ylabel="mean density ratio k [-]")
    axes[0, 2].legend(frameon=False, loc="lower right")
    return figure


def draw_lifts(found: TwoDimensionalRow) -> Figure:
    """Draw load, resistance over the make-up, and density at bottom and top of lumped lifts over the mean density.

    Parameters
    ----------
    found : TwoDimensionalRow
        Roller row in two dimensions.
    """
    figure, axes = panels(1, 3, (3.6, 2.9), gaps=(0.85, 0.3), top=0.3)
    for sequence, colour in zip(found.sequences, PALETTE, strict=False):
        ratio = sequence.values("density_ratio")
        label = f"lifts of {sequence.thickness * 1e3:.2g} mm, {sequence.increments} elements"
        style = {"color": colour, "marker": "o", "markersize": 3}
        axes[0, 0].plot(ratio, sequence.values("load") / 1e3, label=label, **style)
        middle = (ratio + sequence.values("density_before")) / 2
        axes[0, 1].plot(middle, sequence.values("resistance") / sequence.thickness / 1e3, **style)
    thinnest, history = found.lumpings[0], found.row.history
    columns = {"color": "0.4", "linestyle": "--", "label": "columns, single strokes"}
    axes[0, 0].plot(history.density_ratio, history.load / 1e3, **columns)
    fed = history.make_up > 0
    axes[0, 1].plot(history.density_ratio[fed], (history.resistance[fed] / history.make_up[fed]) / 1e3, **columns)
    ratio = thinnest.values("density_ratio")
    axes[0, 2].plot(ratio, thinnest.values("top_density_ratio"), color=PALETTE[1], label="top quarter")
    axes[0, 2].plot(ratio, ratio, color="0.4", linestyle="--", label="mean")
    axes[0, 2].plot(ratio, thinnest.values("bottom_density_ratio"), color=PALETTE[0], label="bottom quarter")
    axes[0, 2].axhline(1.0, color="0.4", linestyle=":", label="no pores")
    labels = ("load P [kN/m]", "resistance over make-up, F/t [kPa]", "density ratio behind the roller [-]")
    for ax, label in zip(axes[0], labels, strict=True):
        ax.set(xlabel="mean density ratio k [-]", ylabel=label)
        if ax is not axes[0, 1]:
            ax.legend(frameon=False, fontsize=8)
    for ax in axes[0, :2]:
        ax.set_ylim(0, None)
    return figure


def draw_map(study: ProcessStudy) -> Figure:
    """Draw load and resistance of one roller at the required density over the speeds of mould and cart."""
    found, machine = study.map, study.problem.machine
    assert found is not None
    figure, axes = panels(1, 2, (4.4, 3.1), gaps=(0.95, 0.3), bottom=0.95, top=0.35)
    x, y = found.mould_speeds * MINUTE, found.cart_speeds
    titles = ("load on one roller [kN], lower estimate", "confined floor of one roller [N], not for sizing")
    for ax, values, title in zip(axes[0], (found.load / 1e3, found.resistance), titles, strict=True):
        shown = np.ma.masked_invalid(values)
        ax.set_facecolor("0.82")
        if shown.count():
            filled = ax.contourf(x, y, shown, 9, cmap="viridis", alpha=0.85)
            label_contours(ax, ax.contour(filled, colors="black", linewidths=0.6))
        point = machine.mould_speed * MINUTE, study.scene.motion.stroke / machine.stroke_period
        ax.plot(*point, "o", color="white", markeredgecolor="black", markersize=7)
        ax.set(xlabel="speed of the mould [m/min]", ylabel="speed of the cart [m/s]", xscale="log", yscale="log")
        ax.set_xticks(x[::8], [f"{speed:.3g}" for speed in x[::8]])
        ax.set_yticks(y[::4], [f"{speed:.3g}" for speed in y[::4]])
        ax.minorticks_off()
        ax.set_title(title, fontsize=10)
    words = (
        f"density ratio {study.row.required_density_ratio:g}; circle: this machine; grey on the right: bite beyond the "
        "nip angle; grey on the left: more strokes than computed"
    )
    figure.legend(handles=[Patch(facecolor="none", label=words)], loc="lower center", frameon=False, fontsize=9)
    return figure
