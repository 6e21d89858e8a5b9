"""Files and digest of a wheel on terrain: contact.json, contact.csv, slip.csv and contact.png."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from compact.analysis.terrain_contact import TerrainContact
from compact.files import write_columns, write_figure, write_json
from compact.report.figures.style import PALETTE, panels

CONTACT_HEADER = ("x_m", "angle_rad", "normal_stress_Pa", "shear_stress_on_terrain_Pa")
SLIP_HEADER = ("slip", "drawbar_N", "torque_Nm", "sinkage_m")
PANEL = (4.3, 3.0)  # [inch]


def write_terrain_contact(directory: Path, contact: TerrainContact) -> list[Path]:
    """Write the summary, the stresses along the contact, drawbar over slip and the figure.

    Parameters
    ----------
    directory : Path
        Existing directory.
    """
    found = contact.result
    angle = np.arcsin(np.clip(found.x / contact.radius, -1, 1))
    summary = directory / "contact.json"
    write_json(summary, terrain_summary(contact))
    columns = (found.x, angle, found.pressure, found.shear_traction)
    written = [summary, write_columns(directory / "contact.csv", CONTACT_HEADER, columns)]
    if contact.slip_curve.size:
        written.append(write_columns(directory / "slip.csv", SLIP_HEADER, tuple(contact.slip_curve.T)))
    written.append(write_figure(directory / "contact.png", draw_terrain_contact(contact)))
    return written


def terrain_summary(contact: TerrainContact) -> dict[str, Any]:
    """Return the results for contact.json, of the whole wheel, in SI units."""
    found, width = contact.result, contact.width

    def quantity(value: float, unit: str) -> dict[str, Any]:
        return {"value": float(value), "unit": unit}

    return {
        "terrain": contact.name,
        "source": contact.source,
        "radius": quantity(contact.radius, "m"),
        "width": quantity(width, "m"),
        "load": quantity(found.load * width, "N"),
        "sinkage": quantity(found.indentation, "m"),
        "compaction_resistance": quantity(found.compaction_resistance * width, "N"),
        "drawbar": quantity(found.drawbar * width, "N"),
        "torque": quantity(found.torque * width, "Nm"),
        "slip": quantity(found.slip, "-"),
        "entry_angle": quantity(found.entry_angle, "rad"),
        "exit_angle": quantity(found.exit_angle, "rad"),
        "angle_of_peak_pressure": quantity(found.peak_angle, "rad"),
        "peak_pressure": quantity(found.peak_pressure, "Pa"),
        "contact_length": quantity(contact.contact_length, "m"),
    }


def terrain_digest(contact: TerrainContact) -> str:
    """Summarise the wheel in lines of text."""
    found, width = contact.result, contact.width
    rows = (
        ("load", found.load * width, "N"),
        ("sinkage", 1e3 * found.indentation, "mm"),
        ("compaction resistance", found.compaction_resistance * width, "N"),
        ("drawbar", found.drawbar * width, "N"),
        ("drawbar over load", found.drawbar / found.load, ""),
        ("torque", found.torque * width, "N m"),
        ("slip", found.slip, ""),
        ("entry angle", float(np.degrees(found.entry_angle)), "degrees"),
        ("exit angle", float(np.degrees(found.exit_angle)), "degrees"),
        ("peak pressure", found.peak_pressure / 1e3, "kPa"),
    )
    lines = [f"wheel of {contact.radius:g} m radius and {width:g} m width on {contact.name}, engine column"]
    lines += [f"  {name:<24}{value:>12.5g} {unit}".rstrip() for name, value, unit in rows if np.isfinite(value)]
    if contact.contact_length < width:
        lines.append(
            f"the contact of {contact.contact_length:.3g} m is shorter than the wheel is wide; the law has the "
            "width for Bekker's b, the smaller side of the loaded area"
        )
    if contact.source:
        lines.append(f"constants: {contact.source}")
    return "\n".join(lines)


def draw_terrain_contact(contact: TerrainContact) -> Figure:
    """Draw stresses along the contact, and drawbar over slip of a wheel with shear."""
    found, curve = contact.result, contact.slip_curve
    figure, axes = panels(1, 2 if curve.size else 1, PANEL, gaps=(0.95, 0.3))
    ax = axes[0, 0]
    ax.plot(1e3 * found.x, found.pressure / 1e3, color=PALETTE[0], label="normal stress")
    ax.plot(1e3 * found.x, found.shear_traction / 1e3, color=PALETTE[1], linestyle="--", label="shear on the terrain")
    ax.set(xlabel="x from the lowest point [mm]", ylabel="stress [kPa]")
    ax.legend(frameon=False, fontsize="small")
    if curve.size:
        right, load = axes[0, 1], found.load * contact.width
        right.plot(curve[:, 0], curve[:, 1] / load, color=PALETTE[0], label="drawbar over load")
        torque = curve[:, 2] / (contact.radius * load)
        right.plot(curve[:, 0], torque, color=PALETTE[1], linestyle="--", label="torque over load and radius")
        right.plot(found.slip, found.drawbar / found.load, "o", color="black", label="this wheel")
        right.axhline(0, color="0.7", linewidth=0.8)
        right.set(xlabel="slip [-]", ylabel="[-]")
        right.legend(frameon=False, fontsize="small")
    return figure
