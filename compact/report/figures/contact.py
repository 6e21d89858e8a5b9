"""Figures of the contact: tractions, density, load and resistance over speed, and fields in the layer.

Each function draws one figure from finished results and returns it.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import NDArray

from compact.analysis.contact_cases import ContactRecord
from compact.engines.halfplane import LineContact
from compact.quantities import CONTACT, FIELD, MOTION, SPEED
from compact.report.figures.style import DASHES, PALETTE, label_decades, panels
from compact.resistance import ResistanceMap
from compact.rolling_contact import ContactResult

if TYPE_CHECKING:
    from meshio import Mesh

SMALL_ACCELERATION = 1e-3  # [-], of the largest acceleration at 1 m/s; small against the memory of the layer
LEAST_SPAN = 0.02  # [-], of a value, shown on each side of a constant curve
FIELD_COLOURS = {"pressure": "viridis", "dissipation": "magma", "density_ratio": "cividis", "plastic_work": "magma"}
FIELD_DECADES = {"dissipation": 3}  # [-], decades of a logarithmic colour scale below the maximum
OUTLINE_NODES = [0, 4, 1, 5, 2, 6, 3, 7]  # of a quadrilateral with nodes on its sides, in order
SHOWN_CONTACTS = 2.5  # [-], contact lengths shown on each side
DEEPEST_RATIO = 2.5  # [-], height over shown half-width, up to which a layer is shown down to its base
FIELD_PANEL_WIDTH = 3.3  # [inch]
BASE_LABELS = {"bonded": "rigid base, bonded", "slip": "rigid base, frictionless"}


def draw_pressure(contact: ContactResult, exact: LineContact, speed: float) -> Figure:
    """Draw pressure and shear traction along one contact against Galin's pressure at the peak of the formulas.

    Parameters
    ----------
    speed : float
        Speed of the roller; its sign gives the direction of the travel [m/s].
    """
    figure, ((ax,),) = panels(1, 1, (6.2, 3.1))
    half_plane = np.linspace(float(exact.trailing), float(exact.leading), 401)
    ax.plot(half_plane * 1e3, exact.pressure(half_plane) / 1e3, color="0.5", label="Galin, half-plane")
    along, shear = np.sign(speed) * contact.x * 1e3, np.sign(speed) * contact.shear_traction / 1e3
    ax.plot(along, contact.pressure / 1e3, ".", markersize=3.5, color=PALETTE[0], label="pressure p")
    if np.any(shear):
        ax.plot(along, shear, "^", markersize=3.5, fillstyle="none", color=PALETTE[1], label="shear q on the mix")
    for draw_zero in (ax.axvline, ax.axhline):
        draw_zero(0, color="0.8", linewidth=0.8, zorder=0)
    ax.set(xlabel=FIELD["travel_position"].axis_label, ylabel=FIELD["contact_stress"].axis_label)
    ax.legend(frameon=False)
    return figure


def draw_density(passes: Sequence[ContactResult]) -> Figure:
    """Draw the density ratio over the height behind each pass, constant in each row of the engine.

    Parameters
    ----------
    passes : sequence of ContactResult
        Results of the passes over a compacting layer.
    """
    from compact.analysis.multipass import density as density_rows

    figure, ((ax,),) = panels(1, 1, (4.4, 3.5))
    for number, contact in enumerate(passes, start=1):
        bottom, top, ratio = density_rows(contact).T
        edges = np.append(bottom, top[-1]) * 1e3
        drawn = {"color": PALETTE[(number - 1) % len(PALETTE)], "linestyle": DASHES[(number - 1) % len(DASHES)]}
        ax.stairs(ratio, edges, orientation="horizontal", baseline=None, label=f"after pass {number}", **drawn)
    ax.set(xlabel=FIELD["density_ratio"].axis_label, ylabel=FIELD["height"].axis_label, ylim=(0, None))
    ax.legend(frameon=False)
    return figure


def draw_loads(contacts: Sequence[ContactRecord]) -> Figure:
    """Draw load and rolling-resistance coefficient over the speed, with bars for the error estimates."""
    figure, (both,) = panels(1, 2, (4.4, 2.9))
    speed, load, coefficient = np.array([[each.speed, each.load, each.coefficient] for each in contacts]).T
    error, miss = np.array([[each.load_error or 0.0, each.resistance_error or 0.0] for each in contacts]).T
    curves = {"load": (load / 1e3, error * load / 1e3), "coefficient": (coefficient, miss * np.abs(coefficient))}
    for ax, color, (name, (values, errors)) in zip(both, PALETTE, curves.items(), strict=False):
        ax.errorbar(speed, values, errors, fmt="o-", color=color, markersize=4)
        ax.set(xscale="log", xlabel=SPEED.axis_label, ylabel=CONTACT[name].axis_label)
        label_decades(ax.xaxis, *ax.get_xlim())
        low, high = ax.get_ylim()
        least = LEAST_SPAN * np.abs(values).max()
        ax.set_ylim(min(low, values.min() - least), max(high, values.max() + least))
    return figure


def draw_resistance(resistance_map: ResistanceMap, acceleration: float) -> Figure:
    """Draw the resistance of one cart over speed at several accelerations, and the added mass.

    Curves are dotted beyond first order in the acceleration, see `ResistanceMap.is_unsteady`.

    Parameters
    ----------
    acceleration : float
        Largest acceleration drawn [m/s2].
    """
    known = resistance_map.added_masses is not None and bool(np.any(resistance_map.added_masses))
    ratios, width = ([4 / 3, 2 / 3], 4.7) if known else ([1], 6.2)
    figure, ((ax, *second),) = panels(1, 1 + known, (width, 3.4), width_ratios=ratios)
    speed = np.linspace(0, resistance_map.speeds[-1], 801)[1:]
    for share, color in zip((-1, -0.5, 0.5, 1), colormaps["coolwarm"]((0.0, 0.2, 0.8, 1.0)), strict=True):
        if known and acceleration:
            _plot_accelerated(ax, resistance_map, speed, share * acceleration, color)
    ax.plot(speed, resistance_map(speed) / 1e3, color="black", label="steady speed, a = 0")
    computed = np.array([each[:2] for each in resistance_map.computed])
    ax.plot(computed[:, 0], computed[:, 1] / 1e3, "o", color="black", markersize=4, label="computed")
    low, high = ax.get_ylim()
    ax.set_ylim(min(0.0, low), max(0.0, 1.05 * high))
    ax.set_ylabel(MOTION["cart_resistance"].axis_label)
    ax.legend(frameon=False, fontsize=8)
    for panel in second:
        small = speed * SMALL_ACCELERATION * (acceleration or 1.0)  # of an unlimited added mass
        panel.plot(speed, (resistance_map(speed, small) - resistance_map(speed)) / small, color="black")
        panel.plot(resistance_map.speeds, resistance_map.added_masses, "o", color="black", markersize=4)
        panel.axhline(0, color="0.8", linewidth=0.8, zorder=0)
        panel.set_ylabel(MOTION["added_mass"].axis_label)
    for panel in (ax, *second):
        panel.set(xlabel=SPEED.axis_label, xlim=(0, 1.02 * resistance_map.speeds[-1]))
    return figure


def _plot_accelerated(
    ax: Axes, resistance_map: ResistanceMap, speed: NDArray[np.float64], acceleration: float, color: Any
) -> None:
    """Draw F(v, a) at one acceleration, dotted beyond first order."""
    force, beyond = resistance_map(speed, acceleration) / 1e3, resistance_map.is_unsteady(speed, acceleration)
    ax.plot(speed, np.where(beyond, np.nan, force), color=color, label=f"a = {acceleration:+.2g} m/s²")
    ax.plot(speed, np.where(beyond, force, np.nan), color=color, linestyle=":")


def draw_fields(layers: Sequence[tuple["Mesh", Any]]) -> Figure:
    """Draw the fields of an engine on the deformed layer, to scale, a row for each contact.

    Each field has one colour scale for all rows.

    Parameters
    ----------
    layers : sequence of tuples
        Mesh with displacement and element means, and the `ContactResult` of the engine.

    Notes
    -----
    Matplotlib draws element means without a graphics driver; VTK terminates the process where the driver is missing.
    """
    names = [name for name in FIELD_COLOURS if name in layers[0][0].cell_data]
    height = layers[0][1].layer.height * 1e3
    reach = SHOWN_CONTACTS * 1e3 * max(contact.leading - contact.trailing for _, contact in layers)
    deep = height > DEEPEST_RATIO * reach
    low, high = height - DEEPEST_RATIO * reach if deep else -0.08 * reach, height + 0.35 * reach
    size = FIELD_PANEL_WIDTH, FIELD_PANEL_WIDTH * (high - low) / (2 * reach)
    margins: dict[str, Any] = {"bottom": 1.15, "top": 0.1, "gaps": (0.35, 0.15)}
    figure, axes = panels(len(layers), len(names), size, **margins, sharex=True, sharey=True)
    for column, name in zip(axes.T, names, strict=True):
        norm = _colour_norm([layer.cell_data[name][0] for layer, _ in layers], name)
        for ax, (layer, rolled) in zip(column, layers, strict=True):
            shown = _draw_field(ax, layer, name, norm)
            _draw_roller(ax, rolled)
            _draw_base(ax, rolled.layer.base, reach, low if deep else None)
        column[-1].set_xlabel(FIELD["position"].axis_label)
        _draw_scale(figure, column[-1], shown, name)
    for ax in axes[:, 0]:
        ax.set_ylabel(FIELD["height"].axis_label)
    axes[0, 0].set(xlim=(-reach, reach), ylim=(low, high))  # shared by all
    return figure


def _colour_norm(values: Sequence[NDArray[np.float64]], name: str) -> Normalize:
    """Return the colour scale of a field over all rows."""
    factor = FIELD[name].plot_factor
    least, most = factor * min(each.min() for each in values), factor * max(each.max() for each in values)
    if name in FIELD_DECADES:
        return LogNorm(most / 10 ** FIELD_DECADES[name], most) if most > 0 else Normalize(0.0, 1.0)
    return Normalize(least, most)


def _draw_field(ax: Axes, layer: "Mesh", name: str, norm: Normalize) -> PolyCollection:
    """Draw the element means of one field on the displaced elements."""
    displaced = (layer.points + layer.point_data["displacement"])[:, :2] * 1e3
    elements = displaced[layer.cells[0].data[:, OUTLINE_NODES]]
    values = np.maximum(layer.cell_data[name][0] * FIELD[name].plot_factor, float(norm.vmin or 0.0))
    shown = PolyCollection(elements, array=values, cmap=FIELD_COLOURS[name], norm=norm, antialiased=False, linewidth=0)
    ax.add_collection(shown)
    ax.set_aspect("equal")
    return shown


def _draw_scale(figure: Figure, ax: Axes, shown: PolyCollection, name: str) -> None:
    """Draw the colour scale of a column below its lowest panel."""
    place, (_, high) = ax.get_position(), figure.get_size_inches()
    bar = figure.add_axes((place.x0, 0.5 / high, place.width, 0.13 / high))
    figure.colorbar(shown, cax=bar, orientation="horizontal", extend="min" if name in FIELD_DECADES else "neither")
    bar.set_xlabel(FIELD[name].axis_label + (", black: below the scale" if name in FIELD_DECADES else ""))


def _draw_base(ax: Axes, base: str, reach: float, bottom: float | None) -> None:
    """Draw the rigid base; write its distance below the panel where the layer is cut at `bottom` [mm]."""
    height, label = 0.02 * reach, BASE_LABELS[base]
    if bottom is not None:
        height, label = bottom, f"{label}, {bottom:.0f} mm below"
    else:
        ax.axhspan(-reach, 0, facecolor="0.85", edgecolor="0.4", hatch="////", linewidth=0)
        ax.axhline(0, color="black", linewidth=1.2)
    ax.text(0, height, label, ha="center", va="bottom", fontsize=8, color="white")


def _draw_roller(ax: Axes, contact: Any) -> None:
    """Draw the roller [mm] and the direction of its travel."""
    bottom, radius = (contact.layer.height - contact.indentation) * 1e3, contact.roller.radius * 1e3
    ax.add_patch(Circle((0, bottom + radius), radius, facecolor="0.92", edgecolor="0.3", linewidth=0.8))
    arrow = f"{contact.speed:.3g} m/s →" if contact.speed > 0 else f"← {-contact.speed:.3g} m/s"
    ax.text(0, bottom + 0.2 * radius, arrow, ha="center", fontsize=9)
