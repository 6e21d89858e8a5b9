"""Figure of a validation case: lines of ours, points of theirs, bands of a spread; one panel for each diagram."""

from collections import Counter

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from compact.report.figures.style import DASHES, PALETTE, panels
from compact.validation.case import Curve, Panel

PANEL = (4.3, 3.0)  # [inch]
LEGEND_SIZE, MARKER_SIZE = "small", 4  # [points] of the marker
MARKERS = ("o", "s", "^", "D", "v", "P")
BAND_OPACITY = 0.25  # [-]


def draw_case(contents: tuple[Panel, ...]) -> Figure:
    """Draw the panels of a case side by side.

    Parameters
    ----------
    contents : tuple of Panel
        Finished curves; at least one panel.

    Returns
    -------
    Figure
        Several sets of points have the colours of the lines at the same place; a single one is black.
    """
    figure, axes = panels(1, len(contents), PANEL, gaps=(0.95, 0.3), left=0.85)
    for ax, panel in zip(axes[0], contents, strict=True):
        _draw_panel(ax, panel)
    return figure


def _draw_panel(ax: Axes, panel: Panel) -> None:
    """Draw one panel with its legend; curves of a style count for themselves."""
    places: Counter[str] = Counter()
    single = sum(curve.style == "theirs" for curve in panel.curves) == 1
    for curve in panel.curves:
        colour = PALETTE[places[curve.style] % len(PALETTE)]
        if curve.style == "theirs":
            _draw_points(ax, curve, "black" if single else colour, MARKERS[places[curve.style] % len(MARKERS)])
        elif curve.style == "band":
            _draw_band(ax, curve, colour)
        else:
            dash = DASHES[places[curve.style] % len(DASHES)]
            ax.plot(curve.x, curve.y, color=colour, linestyle=dash, label=curve.label)
        places[curve.style] += 1
    ax.set(xlabel=panel.x_label, ylabel=panel.y_label)
    ax.set_xscale("log" if panel.log_x else "linear")
    ax.set_yscale("log" if panel.log_y else "linear")
    if any(curve.label for curve in panel.curves):
        ax.legend(frameon=False, fontsize=LEGEND_SIZE)


def _draw_points(ax: Axes, curve: Curve, colour: str, marker: str) -> None:
    """Draw values of other authors as open markers."""
    ax.plot(curve.x, curve.y, marker, color=colour, markersize=MARKER_SIZE, markerfacecolor="none", label=curve.label)


def _draw_band(ax: Axes, curve: Curve, colour: str) -> None:
    """Draw the area between both edges of a band."""
    low = curve.y if curve.y_low is None else curve.y_low
    ax.fill_between(curve.x, low, curve.y, color=colour, alpha=BAND_OPACITY, linewidth=0, label=curve.label)
