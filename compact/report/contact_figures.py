"""Figures of the contact: tractions, density, load and resistance over speed, and fields in the layer."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from compact.analysis.stages.verdict import ModelAnswer
from compact.engines.halfplane import LineContact
from compact.quantities import CONTACT, FIELD, MOTION, SPEED, Quantity
from compact.report import figures
from compact.report.figures import PALETTE, ZERO, curve, panels
from compact.resistance import ResistanceMap
from compact.rolling_contact import Contact

if TYPE_CHECKING:
    from meshio import Mesh

LEAST_SPAN = 0.02  # [-], of a value, shown on each side of a constant curve
FIELD_COLOURS = {"pressure": "viridis", "dissipation": "magma", "density_ratio": "cividis", "plastic_work": "magma"}
FIELD_DECADES = {"dissipation": 3}  # [-], decades of a logarithmic colour scale below the maximum
PREFERRED_FIELDS = ("density_ratio", "pressure")  # of a picture
CORNERS = 4  # [-], nodes of a quadrilateral without nodes on its sides
OUTLINE_NODES = [0, 4, 1, 5, 2, 6, 3, 7]  # of a quadrilateral with nodes on its sides, in order
SHOWN_CONTACTS = 2.5  # [-], contact lengths shown on each side
DEEPEST_RATIO = 2.5  # [-], height over shown half-width, up to which a layer is shown down to its base
FIELD_PANEL_WIDTH = 3.3  # [inch]
SATURATED: dict[str, Any] = {"facecolor": "none", "edgecolor": "0.1", "hatch": "/////", "linewidth": 0}
BASE_LABELS = {"bonded": "rigid base, bonded", "slip": "rigid base, frictionless"}


def draw_pressure(contact: Contact, exact: LineContact, speed: float) -> Figure:
    """Draw pressure and shear traction along one contact against Galin's pressure at the peak of the formulas.

    Parameters
    ----------
    speed : float
        Speed of the roller; its sign gives the direction of the travel [m/s].
    """
    figure, ((ax,),) = panels(1, 1, (6.2, 3.1))
    axes = ax, FIELD["travel_position"], FIELD["contact_stress"]
    half_plane = np.linspace(float(exact.trailing), float(exact.leading), 401)
    curve(*axes, half_plane, exact.pressure(half_plane), color="0.5", label="Galin, half-plane")
    along, shear = np.sign(speed) * contact.x, np.sign(speed) * contact.shear_traction
    curve(*axes, along, contact.pressure, ".", markersize=3.5, color=PALETTE[0], label="pressure p")
    if np.any(shear):
        mark: dict[str, Any] = {"markersize": 3.5, "fillstyle": "none", "color": PALETTE[1]}
        curve(*axes, along, shear, "^", label="shear q on the mix", **mark)
    ax.axvline(0, **ZERO)
    ax.axhline(0, **ZERO)
    ax.legend(frameon=False)
    return figure


def draw_loads(contacts: Sequence[Contact]) -> Figure:
    """Draw load and rolling-resistance coefficient over the speed, with bars for the error estimates."""
    figure, (both,) = panels(1, 2, (4.4, 2.9))
    speed = np.array([each.speed for each in contacts])
    for ax, color, name, error in zip(both, PALETTE, ("load", "coefficient"), ("load", "resistance"), strict=False):
        values = np.array([getattr(each, name) for each in contacts]) * CONTACT[name].plot_factor
        errors = np.array([getattr(each, f"{error}_error") or 0.0 for each in contacts]) * np.abs(values)
        ax.errorbar(speed, values, errors, fmt="o-", color=color, markersize=4)
        ax.set(xscale="log", xlabel=SPEED.axis_label, ylabel=CONTACT[name].axis_label)
        figures.label_decades(ax.xaxis)
        (low, high), least = ax.get_ylim(), LEAST_SPAN * np.abs(values).max()
        ax.set_ylim(min(low, values.min() - least), max(high, values.max() + least))
    return figure


def draw_resistance(resistance_map: ResistanceMap, acceleration: float) -> Figure:
    """Draw the resistance of one cart over speed at several accelerations.

    Curves are dotted beyond first order in the acceleration, see `ResistanceMap.is_unsteady`.

    Parameters
    ----------
    acceleration : float
        Largest acceleration drawn [m/s2].
    """
    masses, resistance = resistance_map.added_masses, MOTION["cart_resistance"]
    known = masses is not None and bool(np.any(masses))
    figure, ((ax,),) = panels(1, 1, (6.2, 3.4))
    speed = np.linspace(0, resistance_map.speeds[-1], 801)[1:]
    axes = ax, SPEED, resistance
    for share, color in zip((-1, -0.5, 0.5, 1), colormaps["coolwarm"]((0.0, 0.2, 0.8, 1.0)), strict=True):
        if known and acceleration:
            each = share * acceleration
            force, beyond = resistance_map(speed, each), resistance_map.is_unsteady(speed, each)
            curve(*axes, speed, np.where(beyond, np.nan, force), color=color, label=f"a = {each:+.2g} m/s²")
            curve(*axes, speed, np.where(beyond, force, np.nan), color=color, linestyle=":")
    curve(*axes, speed, resistance_map(speed), color="black", label="steady speed, a = 0")
    computed = np.array([each[:2] for each in resistance_map.computed]).T
    curve(*axes, *computed, "o", color="black", markersize=4, label="computed")
    low, high = ax.get_ylim()
    ax.set_ylim(min(0.0, low), max(0.0, 1.05 * high))
    ax.legend(frameon=False, fontsize=8)
    ax.set_xlim(0, 1.02 * resistance_map.speeds[-1])
    return figure


def draw_models(models: Sequence[ModelAnswer], speeds: Mapping[str, float]) -> Figure:
    """Draw the resistance of one cart over its speed by all models.

    Parameters
    ----------
    models : sequence of ModelAnswer
        Answers, that of the engine of the scene first. Its band is the spread over the laws of the mix, that of the
        others the error estimate.
    speeds : mapping of str to float
        Largest speed of each law that is marked [m/s].
    """
    figure, ((ax,),) = panels(1, 1, (2.9, 2.3), **figures.PHONE_MARGINS)
    resistance, fastest, largest = MOTION["cart_resistance"], 1.08 * max(speeds.values()), 0.0
    for number, model in enumerate(models):
        force, (color, _, dash) = model.steady, figures.ENGINE_STYLES.get(model.engine, figures.OTHER_STYLE)
        speed = np.linspace(0, min(fastest, float(getattr(force, "speeds", [fastest])[-1])), 401)[1:]
        values = np.asarray(force(speed, np.zeros_like(speed))) * resistance.plot_factor
        label, width = model.engine if model.valid else f"{model.engine}*", 1.7 if number else 3.0
        ax.plot(speed, values, linestyle=dash, color=color, label=label, linewidth=width, zorder=2.5 + bool(number))
        low, high = model.spread or (1 - (model.error or 0.0), 1 + (model.error or 0.0))
        ax.fill_between(speed, low * values, high * values, color=color, alpha=0.18, linewidth=0)
        largest = max(largest, float(max(high, 1.0) * values.max()))
    for each in speeds.values():
        ax.axvline(each, color="0.45", linewidth=0.8, linestyle=(0, (2, 2)), zorder=1)
    ax.set(xlim=(0, fastest), ylim=(0, 1.05 * largest))
    figures.for_phone(ax, SPEED.axis_label, resistance.axis_label)
    figure.legend(*ax.get_legend_handles_labels(), **figures.PHONE_LEGEND | {"ncols": 2, "columnspacing": 1.0})
    return figure


def draw_picture(mesh: "Mesh", contact: Contact | None = None, field: str | None = None) -> Figure:
    """Draw one field of the displaced layer, to scale, of a contact or a file.

    Parameters
    ----------
    mesh, contact
        As of `draw_fields`.
    field : str, optional
        Name of the field; the density ratio, or the pressure of a linear layer, by default.

    Raises
    ------
    ValueError
        If the mesh has no such field.
    """
    known = [name for name, values in mesh.cell_data.items() if np.ndim(values[0]) == 1]
    found = [name for name in ((field,) if field else (*PREFERRED_FIELDS, *known)) if name in known]
    if not found:
        raise ValueError(f"the layer has the fields {', '.join(known) or 'none'}, got {field!r}")
    return draw_fields([(mesh, contact)], found[:1])


def draw_fields(layers: Sequence[tuple["Mesh", Contact | None]], names: Sequence[str] = ()) -> Figure:
    """Draw the fields of an engine on the deformed layer, to scale, a row for each contact.

    Each field has one colour scale for all rows. Mix at rest at the saturation limit is hatched.

    Parameters
    ----------
    layers : sequence of tuples
        Mesh with displacement and element means, and the contact, around which it is drawn; None for the whole mesh.
    names : sequence of str, optional
        Names of the fields; all of an engine by default.
    """
    names = names or [name for name in FIELD_COLOURS if name in layers[0][0].cell_data]
    outlines = [_outlines(mesh) for mesh, _ in layers]
    contacts, deep = [contact for _, contact in layers if contact is not None], False
    limit = getattr(contacts[0].material, "saturation_limit", np.inf) if contacts else np.inf
    (left, low), (right, high) = outlines[0].min(axis=(0, 1)), outlines[0].max(axis=(0, 1))
    if contacts:
        reach = SHOWN_CONTACTS * 1e3 * max(contact.leading - contact.trailing for contact in contacts)
        left, right, height = -reach, reach, contacts[0].layer.height * 1e3
        deep = height > DEEPEST_RATIO * reach
        low, high = height - DEEPEST_RATIO * reach if deep else -0.08 * reach, height + 0.35 * reach
    width = FIELD_PANEL_WIDTH if len(names) > 1 else 2 * FIELD_PANEL_WIDTH
    size = width, width * (high - low) / (right - left)
    figure, axes = panels(len(layers), len(names), size, (0.35, 0.15), "xy", bottom=1.15, top=0.1)
    for column, name in zip(axes.T, names, strict=True):
        quantity = FIELD.get(name, Quantity(name, "1"))
        values = [np.asarray(mesh.cell_data[name][0]) * quantity.plot_factor for mesh, _ in layers]
        norm, decades = Normalize(min(map(np.min, values)), max(map(np.max, values))), FIELD_DECADES.get(name)
        remark = ", black: below the scale" if decades else ""
        if decades is not None:
            most = float(norm.vmax or 0.0)
            norm = LogNorm(most / 10**decades, most) if most > 0 else Normalize(0.0, 1.0)
        for ax, (_, contact), outline, each in zip(column, layers, outlines, values, strict=True):
            shown = PolyCollection(
                outline, array=np.maximum(each, float(norm.vmin or 0.0)), cmap=FIELD_COLOURS.get(name, "viridis"),
                norm=norm, antialiased=False, linewidth=0,
            )  # fmt: skip
            ax.add_collection(shown)
            if name == "density_ratio" and np.any(each >= limit):
                ax.add_collection(PolyCollection(outline[each >= limit], **SATURATED))
                remark = f", hatched: at the limit {limit:g}"
            ax.set_aspect("equal")
            if contact is not None:
                _draw_surroundings(ax, contact, right, low if deep else None)
        column[-1].set_xlabel(FIELD["position"].axis_label)
        place, tall = column[-1].get_position(), figure.get_size_inches()[1]
        bar = figure.add_axes((place.x0, 0.5 / tall, place.width, 0.13 / tall))
        figure.colorbar(shown, cax=bar, orientation="horizontal", extend="min" if decades else "neither")
        bar.set_xlabel(quantity.axis_label + remark)
    for ax in axes[:, 0]:
        ax.set_ylabel(FIELD["height"].axis_label)
    axes[0, 0].set(xlim=(left, right), ylim=(low, high))  # shared by all
    return figure


def _outlines(mesh: "Mesh") -> Any:
    """Return the outlines of the displaced elements [mm], shape (elements, corners, 2)."""
    nodes = mesh.cells[0].data
    nodes = nodes[:, OUTLINE_NODES] if nodes.shape[1] > CORNERS else nodes
    return (mesh.points + mesh.point_data.get("displacement", 0.0))[nodes, :2] * 1e3


def _draw_surroundings(ax: Axes, contact: Any, reach: float, bottom: float | None) -> None:
    """Draw roller, arrow of its travel and rigid base [mm], or the depth of the base of a layer cut at `bottom`."""
    lowest, radius = (contact.layer.height - contact.indentation) * 1e3, contact.roller.radius * 1e3
    ax.add_patch(Circle((0, lowest + radius), radius, facecolor="0.92", edgecolor="0.3", linewidth=0.8))
    arrow = f"{contact.speed:.3g} m/s →" if contact.speed > 0 else f"← {-contact.speed:.3g} m/s"
    ax.text(0, lowest + 0.2 * radius, arrow, ha="center", fontsize=9)
    height, label = 0.02 * reach, BASE_LABELS[contact.layer.base]
    if bottom is not None:
        height, label = bottom, f"{label}, {bottom:.0f} mm below"
    else:
        ax.axhspan(-reach, 0, facecolor="0.85", edgecolor="0.4", hatch="////", linewidth=0)
        ax.axhline(0, color="black", linewidth=1.2)
    ax.text(0, height, label, ha="center", va="bottom", fontsize=8, color="white")
