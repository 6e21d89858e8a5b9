"""Figures of a study: kinematics, drive force and power, cams, reactions, crankshaft, contact and fields.

Each function draws one figure from finished results and returns it; a law keeps its colour and dash in all of them.
Colours are safe for red-green blindness: two laws differ by 16 or more of CIELAB's 1976 distance to normal eyes, to
deuteranopes and to protanopes (Machado, Oliveira and Fernandes 2009), laws of one family also by their lightness.
"""

from itertools import pairwise
from types import MappingProxyType

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure

FAMILIES = MappingProxyType(  # family -> law -> colour, dark to light
    {
        "rest to rest": {
            "constant-velocity": "#03255d",
            "cubic": "#00449f",
            "quintic": "#577388",
            "septic": "#509afa",
            "complex": "#9dc8fe",
        },
        "constant speed, combined": {"combined-2": "#1e4740", "combined-3": "#5b735f", "combined-4": "#5adda2"},
        "constant speed, reversal": {
            "reversal-2": "#702e01",
            "reversal-3": "#bf4809",
            "reversal-4": "#f7740f",
            "reversal-4-free-jerk": "#f5bc63",
        },
        "constant speed, free turn": {
            "reversal-3-free-acceleration": "#4d180e",
            "reversal-4-free-acceleration": "#c16243",
            "reversal-4-free-both": "#fe8b7b",
        },
        "comparators": {
            "parabolic": "#281b37",
            "harmonic": "#8862b1",
            "cycloidal": "#bf8ac2",
            "modified-trapezoid": "#e7b9d5",
        },
        "machines and tables": {"crank": "#000000", "gear-sector": "#989898"},
    }
)
# what is no law, by Okabe and Ito: blue, vermillion, bluish green, reddish purple, orange, sky blue
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
HURRY = 1e-3  # of the acceleration at 1 m/s: small against what is slow
CROP = 3.0  # times the median of the peaks, beyond which a figure of drives does not reach
BAD = "0.92"  # behind what cannot be made
LEAST_SPAN = 0.02  # of a value, shown to each side of it
LAW_POINTS = 400  # of a law in a figure
BROADEST, THINNER = 2.8, 0.87  # lines of one panel: the first [points], and from one to the next
TITLED = 1.0  # height of a title over its panel; without it every label is measured to find one
DASHES = ("-", "--", ":", "-.", (0, (8, 2, 1, 2, 1, 2)))
SYMBOLS = {
    "position": "travel x [m]",
    "velocity": "velocity v [m/s]",
    "acceleration": "acceleration a [m/s²]",
    "jerk": "jerk [m/s³]",
    "drive_force": "drive force along the motion [kN]",
    "drive_power": "drive power [W]",
}


def look(name):
    """Colour and dash of a law; laws that are not in FAMILIES, such as tables, are black."""
    for members in FAMILIES.values():
        if name in members:
            return {"color": members[name], "linestyle": DASHES[list(members).index(name)]}
    return {"color": "black", "linestyle": "-"}


def _families(names):
    """Family -> the names of it that are at hand, empty families left out; strangers join the machines."""
    known = {name for members in FAMILIES.values() for name in members}
    groups = {family: [n for n in members if n in names] for family, members in FAMILIES.items()}
    groups["machines and tables"] += [name for name in names if name not in known]
    return {family: members for family, members in groups.items() if members}


def _grid(families, columns, width=3.6):
    size = (width, 2.0)
    figure, axes = panels(len(families), len(columns), size, right=2.6, top=0.35, sharex=True, sharey="col")
    for ax, column in zip(axes[0], columns, strict=True):
        ax.set_title(SYMBOLS[column], fontsize=11, y=TITLED)
    for ax in axes.ravel():
        ax.axhline(0, color="0.8", linewidth=0.8, zorder=0)
        ax.margins(x=0)
        ax.locator_params(axis="y", nbins=4)  # labels take most of the time of a figure
    for ax, family in zip(axes[:, 0], families, strict=True):
        ax.set_ylabel(family, fontsize=10)
    for ax in axes[-1]:
        ax.set_xlabel("time t [s]")
    return figure, axes


def panels(rows, columns, size, *, left=0.8, right=0.2, bottom=0.55, top=0.15, gaps=(0.8, 0.3), **shared):
    """A figure with a grid of panels: their size, the margins and the gaps across and along, all in inches.

    Constrained layout would find the margins itself, and take as much time again as the whole figure.
    """
    across, along = (count * (each + gap) - gap for count, each, gap in zip((columns, rows), size, gaps, strict=True))
    wide, high = across + left + right, along + bottom + top
    figure = Figure(figsize=(wide, high))
    axes = figure.subplots(rows, columns, squeeze=False, **shared)
    margins = {"left": left / wide, "right": 1 - right / wide, "bottom": bottom / high, "top": 1 - top / high}
    figure.subplots_adjust(**margins, wspace=gaps[0] / size[0], hspace=gaps[1] / size[1])
    return figure, axes


def legend_below(figure, ax, columns):
    """The legend of one panel under all of them, in columns."""
    figure.legend(*ax.get_legend_handles_labels(), loc="lower center", ncols=columns, frameon=False)


def _line(ax, name, time, values, impulsive):
    label = f"{name} (velocity jumps)" if impulsive else name
    width = BROADEST * THINNER ** len(ax.lines)  # what is drawn first is the broader, so that none hides another
    ax.plot(time, values, linewidth=width, label=label, **look(name))


def _legends(axes):
    for ax in axes[:, -1]:
        ax.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.02, 0.5), frameon=False, handlelength=3.2)


def kinematics(cycles):
    """Velocity, acceleration and jerk of every law over the way there, `Cycle`s by name, whatever the drive makes of
    them."""
    families = _families(cycles)
    figure, axes = _grid(families, ("velocity", "acceleration", "jerk"))
    for row, members in zip(axes, families.values(), strict=True):
        for name in members:
            there = cycles[name].there
            phase = _phases(there.curve.x)
            impulsive = any(join.order == 1 for join in there.joins())
            for ax, order in zip(row, (1, 2, 3), strict=True):
                _line(ax, name, phase * there.duration, there.at_phase(phase, order), impulsive)
    _legends(axes)
    return figure


def _phases(joined):
    """Phases of a law from join to join, both sides of each, so that what jumps is drawn upright."""
    count = max(3, LAW_POINTS // (len(joined) - 1))
    return np.concatenate(
        [np.linspace(np.nextafter(low, 2.0), np.nextafter(high, -1.0), count) for low, high in pairwise(joined)]
    )


def drive(runs):
    """Drive force, + along the motion, and power of every law over the cycle there and back."""
    families = _families(runs)
    figure, axes = _grid(families, ("drive_force", "drive_power"), width=4.6)
    for row, members in zip(axes, families.values(), strict=True):
        for name in members:
            run = runs[name]
            _line(row[0], name, run.time, run.direction * run.drive_force / 1e3, run.impulses)
            _line(row[1], name, run.time, run.drive_power, run.impulses)
    for column, of, unit, factor in zip(axes.T, ("peak_force", "peak_power"), ("kN", "W"), (1e-3, 1.0), strict=True):
        peaks = {name: getattr(run, of) * factor for name, run in runs.items()}
        _cropped(column[0], peaks.values())
        for ax, members in zip(column, families.values(), strict=True):
            _name_cropped(ax, {name: peaks[name] for name in members}, unit)
    _legends(axes)
    return figure


def _cropped(ax, peaks):
    """Leave out of an axis what a few laws ask many times over, as behind a spring those whose velocity jumps."""
    finite = [peak for peak in peaks if np.isfinite(peak)]
    most = CROP * np.median(finite) if finite else np.inf
    low, high = ax.get_ylim()
    ax.set_ylim(max(low, -most), min(high, most))


def _three(value):
    """A number to three digits, without an exponent up to a million.

    >>> _three(7.519), _three(1002.6)
    ('7.52', '1003')
    """
    return f"{value:.3g}" if abs(value) < 100 else f"{value:.0f}"


def _name_cropped(ax, peaks, unit):
    """Say low in the panel, where no peak is, which laws reach beyond its scale, and how far."""
    limit = max(map(abs, ax.get_ylim()))
    said = [
        f"▲ {name}: " + (f"peak {_three(peak)} {unit}, off the scale" if np.isfinite(peak) else "infinite at its jumps")
        for name, peak in peaks.items()
        if peak > limit
    ]
    if said:
        ax.text(
            0.03, 0.05, "\n".join(said), transform=ax.transAxes, ha="left", va="bottom", fontsize=8,
            bbox={"facecolor": "white", "edgecolor": "0.6", "pad": 2},
        )  # fmt: skip


def reactions(runs, names):
    """Guide-wheel reactions over the cycle for the laws named; below zero the wheel runs on the lower rail."""
    figure, (axes,) = panels(1, len(names), (5.2, 2.5), bottom=0.85, top=0.3, gaps=(0.3, 0.0), sharey=True)
    for ax, name in zip(axes, names, strict=True):
        run = runs[name]
        front, rear = run.state.forces.front_reaction / 1e3, run.state.forces.rear_reaction / 1e3
        ax.plot(run.time, front, color=PALETTE[0], label="front wheel N₁")
        ax.plot(run.time, rear, color=PALETTE[1], linestyle="--", label="rear wheel N₂")
        if min(front.min(), rear.min()) < 0:
            ax.axhspan(min(front.min(), rear.min()), 0, color="0.92", zorder=0, label="lifted off: on the lower rail")
        ax.axhline(0, color="0.6", linewidth=0.8)
        ax.set_title(name, y=TITLED)
        ax.set_xlabel("time t [s]")
        ax.margins(x=0)
    axes[0].set_ylabel("reaction of the guide wheel [kN]")
    legend_below(figure, axes[-1], columns=3)
    return figure


def cams(cams, names, follower):
    """Profiles of the cams of one kind of follower, a panel per law, with the path of the roller's centre.

    The panel of a cam that is undercut is shaded and says so.
    """
    columns = min(7, len(names))
    rows = -(-len(names) // columns)
    figure, axes = panels(rows, columns, (1.6, 1.8), top=0.45, gaps=(0.45, 0.5), sharex=True, sharey=True)
    axes = axes.ravel()
    phi = np.linspace(0, 2 * np.pi, 2001)
    for ax in axes[len(names) :]:
        ax.set_visible(False)
    for ax, name in zip(axes[: len(names)], names, strict=True):
        cam = cams[name, follower]
        radius = cam.radius(phi)
        ax.plot(*cam.profile(phi), color=look(name)["color"], linewidth=1.6)
        ax.plot(radius * np.cos(phi), radius * np.sin(phi), color="0.6", linewidth=0.7, linestyle="--")
        ax.plot(0, 0, "k+", markersize=6)
        ax.set_title(name + ("\nUNDERCUT" if cam.undercut else "\n"), fontsize=8, y=TITLED)
        if cam.undercut:  # by shade and words, as colours are the laws'
            ax.set_facecolor(BAD)
        ax.set_aspect("equal")
        ax.tick_params(labelsize=7)
    figure.supxlabel("x [m]", fontsize=9)
    figure.supylabel("y [m]", fontsize=9)
    return figure


def crank(turns):
    """Torque and power of the shaft over a turn for 1 to 4 carts; dashed the means."""
    figure, (both,) = panels(1, 2, (4.4, 2.9), bottom=0.85)
    shafts = [key for key in turns if key.isdigit()]
    for key, color in zip(shafts, colormaps["viridis"](np.linspace(0, 0.85, len(shafts))), strict=True):
        turn = turns[key]
        label = f"{key} cart{'s' if key != '1' else ''}"
        for ax, values in zip(both, (turn.torque, turn.power), strict=True):
            ax.plot(np.degrees(turn.angle), values / 1e3, color=color, label=label)
            ax.axhline(turn.mean(values) / 1e3, color=color, linestyle="--", linewidth=0.8)
    for ax, title in zip(both, ("torque of the shaft [kN m]", "power of the shaft [kW]"), strict=True):
        ax.set_xlabel("angle of the shaft [°]")
        ax.set_ylabel(title)
        ax.set_xticks(range(0, 361, 45))
        ax.margins(x=0)
    legend_below(figure, both[0], columns=4)
    return figure


def contact(rolled, exact, speed):
    """Pressure and shear traction along one contact, with Galin's pressure at the formulas' peak as a line.

    Seen along the travel, whichever way the speed points.
    """
    figure, ((ax,),) = panels(1, 1, (6.2, 3.1))
    half_plane = np.linspace(float(exact.trailing), float(exact.leading), 401)
    ax.plot(half_plane * 1e3, exact.pressure(half_plane) / 1e3, color="0.5", label="Galin, half-plane")
    along, shear = np.sign(speed) * rolled.x * 1e3, np.sign(speed) * rolled.shear_traction / 1e3
    ax.plot(along, rolled.pressure / 1e3, ".", markersize=3.5, color=PALETTE[0], label="pressure p")
    if np.any(shear):
        ax.plot(along, shear, "x", markersize=3, color=PALETTE[1], label="shear q on the mix")
    ax.axvline(0, color="0.8", linewidth=0.8, zorder=0)
    ax.axhline(0, color="0.8", linewidth=0.8, zorder=0)
    ax.set_xlabel("x from the lowest point, + along the travel [mm]")
    ax.set_ylabel("contact stress [kPa]")
    ax.legend(frameon=False)
    return figure


def density(passes):
    """Density ratio over the height of the mix behind each pass; rows as the engine has them."""
    from compact.analysis.multipass import density

    figure, ((ax,),) = panels(1, 1, (4.4, 3.5))
    for number, rolled in enumerate(passes, start=1):
        bottom, top, ratio = density(rolled).T
        edges = np.append(bottom, top[-1]) * 1e3
        drawn = {"color": PALETTE[(number - 1) % len(PALETTE)], "linestyle": DASHES[(number - 1) % len(DASHES)]}
        ax.stairs(ratio, edges, orientation="horizontal", baseline=None, label=f"after pass {number}", **drawn)
    ax.set_xlabel("density ratio k [-]")
    ax.set_ylabel("height above the base y [mm]")
    ax.set_ylim(0, None)
    ax.legend(frameon=False)
    return figure


def speeds(contacts):
    """Load and resistance coefficient over the speed, bars for the engine's own error."""
    figure, (both,) = panels(1, 2, (4.4, 2.9))
    speed, load, coefficient = np.array([[each.speed, each.load, each.coefficient] for each in contacts]).T
    error, miss = np.array([[each.load_error or 0.0, each.resistance_error or 0.0] for each in contacts]).T
    both[0].errorbar(speed, load / 1e3, error * load / 1e3, fmt="o-", color=PALETTE[0], markersize=4)
    both[0].set_ylabel("load P [kN/m]")
    both[1].errorbar(speed, coefficient, miss * np.abs(coefficient), fmt="o-", color=PALETTE[1], markersize=4)
    both[1].set_ylabel("resistance over load [-]")
    for ax, values in zip(both, (load / 1e3, coefficient), strict=True):
        ax.set_xscale("log")
        ax.set_xlabel("speed v [m/s]")
        low, high = ax.get_ylim()
        least = LEAST_SPAN * np.abs(values).max()  # so that what is constant looks it
        ax.set_ylim(min(low, values.min() - least), max(high, values.max() + least))
    return figure


def resistance(met, acceleration):
    """Resistance of one cart over speed, steady and at some accelerations up to one [m/s2], beside what it adds, M(v).

    Dotted where the motion is too unsteady for first order in its acceleration (`ResistanceMap.is_unsteady`).
    """
    known = met.added_masses is not None and np.any(met.added_masses)
    ratios, width = ([4 / 3, 2 / 3], 4.7) if known else ([1], 6.2)
    figure, ((ax, *beside),) = panels(1, 1 + known, (width, 3.4), width_ratios=ratios)
    speed = np.linspace(0, met.speeds[-1], 801)[1:]
    for share, color in zip((-1, -0.5, 0.5, 1), colormaps["coolwarm"]((0.0, 0.2, 0.8, 1.0)), strict=True):
        if known and acceleration:
            _hurried(ax, met, speed, share * acceleration, color)
    ax.plot(speed, met(speed) / 1e3, color="black", label="steady speed, a = 0")
    ax.plot(met.speeds, met.forces / 1e3, "o", color="black", markersize=4, label="computed")
    low, high = ax.get_ylim()
    ax.set_ylim(min(0.0, low), max(0.0, 1.05 * high))
    ax.set_ylabel("resistance of the mix to one cart F [kN]")
    ax.legend(frameon=False, fontsize=8)
    for panel in beside:
        small = speed * HURRY * (acceleration or 1.0)  # a M(v) is not held back there; laws may have no acceleration
        panel.plot(speed, (met(speed, small) - met(speed)) / small, color="black")
        panel.plot(met.speeds, met.added_masses, "o", color="black", markersize=4)
        panel.axhline(0, color="0.8", linewidth=0.8, zorder=0)
        panel.set_ylabel("what acceleration adds, M [N per m/s²]")
    for panel in (ax, *beside):
        panel.set_xlabel("speed v [m/s]")
        panel.set_xlim(0, 1.02 * met.speeds[-1])
    return figure


def _hurried(ax, met, speed, acceleration, color):
    """F(v, a) at one acceleration, dotted where that is beyond first order."""
    force, beyond = met(speed, acceleration) / 1e3, met.is_unsteady(speed, acceleration)
    ax.plot(speed, np.where(beyond, np.nan, force), color=color, label=f"a = {acceleration:+.2g} m/s²")
    ax.plot(speed, np.where(beyond, force, np.nan), color=color, linestyle=":")


FIELDS = {
    "pressure": ("mean pressure [kPa]", 1e-3, "viridis"),
    "dissipation": ("dissipation [kW/m³]", 1e-3, "magma"),
    "density_ratio": ("density ratio [-]", 1.0, "cividis"),
    "plastic_work": ("plastic work [kJ/m³]", 1e-3, "magma"),
}
DECADES = {"dissipation": 3}  # below its largest, shown by its logarithm: over the speeds it grows thirtyfold
OUTLINE = [0, 4, 1, 5, 2, 6, 3, 7]  # of a quadrilateral with nodes on its sides, these in turn
REACH = 2.5  # contact lengths shown to each side
DEEPEST = 2.5  # times that, of a layer that is shown down to its base
FIELD_WIDTH = 3.3  # of a panel [inch]
BASES = {"bonded": "rigid base, bonded", "slip": "rigid base, mix slips"}


def fields(layers):
    """What an engine knows of FIELDS in the layer as it is deformed, true to scale, a row for each (mesh, contact).

    One colour scale of each field holds for all rows; the base is drawn where the layer ends.
    Drawn by matplotlib, which shows each element's mean as it is and needs no driver; where VTK misses its graphics
    driver it ends the whole process. The files themselves open in pyvista and ParaView.
    """
    names = [name for name in FIELDS if name in layers[0][0].cell_data]
    height, reach = layers[0][1].layer.height * 1e3, REACH * 1e3 * max(r.leading - r.trailing for _, r in layers)
    deep = height > DEEPEST * reach
    low, high = height - DEEPEST * reach if deep else -0.08 * reach, height + 0.35 * reach
    size = FIELD_WIDTH, FIELD_WIDTH * (high - low) / (2 * reach)
    margins = {"bottom": 1.15, "top": 0.1, "gaps": (0.35, 0.15)}
    figure, axes = panels(len(layers), len(names), size, **margins, sharex=True, sharey=True)
    for column, name in zip(axes.T, names, strict=True):
        norm = _norm([layer.cell_data[name][0] for layer, _ in layers], name)
        for ax, (layer, rolled) in zip(column, layers, strict=True):
            shown = _field(ax, layer, name, norm)
            _roller(ax, rolled)
            _base(ax, rolled.layer.base, reach, low if deep else None)
        column[-1].set_xlabel("x from the lowest point [mm]")
        _scale(figure, column[-1], shown, name)
    for ax in axes[:, 0]:
        ax.set_ylabel("height y [mm]")
    axes[0, 0].set(xlim=(-reach, reach), ylim=(low, high))  # shared by all
    return figure


def _norm(values, name):
    """The colour scale of a field over all rows."""
    factor = FIELDS[name][1]
    least, most = factor * min(each.min() for each in values), factor * max(each.max() for each in values)
    if name in DECADES:
        return LogNorm(most / 10 ** DECADES[name], most) if most > 0 else Normalize(0.0, 1.0)
    return Normalize(least, most)


def _field(ax, layer, name, norm):
    """Element means of one field on the displaced elements."""
    from matplotlib.collections import PolyCollection

    _, factor, cmap = FIELDS[name]
    displaced = (layer.points + layer.point_data["displacement"])[:, :2] * 1e3
    elements = displaced[layer.cells[0].data[:, OUTLINE]]
    values = np.maximum(layer.cell_data[name][0] * factor, norm.vmin)  # a logarithm has no colour for nothing
    shown = PolyCollection(elements, array=values, cmap=cmap, norm=norm, antialiased=False, linewidth=0)  # no seams
    ax.add_collection(shown)
    ax.set_aspect("equal")
    return shown


def _scale(figure, ax, shown, name):
    """The colour scale of a column, under its lowest panel."""
    place, (_, high) = ax.get_position(), figure.get_size_inches()
    bar = figure.add_axes((place.x0, 0.5 / high, place.width, 0.13 / high))
    figure.colorbar(shown, cax=bar, orientation="horizontal", extend="min" if name in DECADES else "neither")
    bar.set_xlabel(FIELDS[name][0] + (", black: less" if name in DECADES else ""))


def _base(ax, base, reach, bottom):
    """The rigid base under the layer; of a layer too deep for the panel, how far below its `bottom` it lies [mm]."""
    if bottom is not None:
        ax.text(0, bottom, f"{BASES[base]}, {bottom:.0f} mm below", ha="center", va="bottom", fontsize=8, color="white")
        return
    ax.axhspan(-reach, 0, facecolor="0.85", edgecolor="0.4", hatch="////", linewidth=0)
    ax.axhline(0, color="black", linewidth=1.2)
    ax.text(0, 0.02 * reach, BASES[base], ha="center", va="bottom", fontsize=8, color="white")


def _roller(ax, rolled):
    """The roller where it stands, in mm, and which way it goes."""
    from matplotlib.patches import Circle

    bottom, radius = (rolled.layer.height - rolled.indentation) * 1e3, rolled.roller.radius * 1e3
    ax.add_patch(Circle((0, bottom + radius), radius, facecolor="0.92", edgecolor="0.3", linewidth=0.8))
    arrow = f"{rolled.speed:.3g} m/s →" if rolled.speed > 0 else f"← {-rolled.speed:.3g} m/s"
    ax.text(0, bottom + 0.2 * radius, arrow, ha="center", fontsize=9)
