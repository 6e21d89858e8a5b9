"""Files of a cam for the workshop: points as CSV, drawings as SVG and DXF in millimetres, and an animation as SVG."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from compact.cams import workshop_drawing
from compact.cams.animation import animated_svg
from compact.cams.machining import MICROMETRE, Cut, cut
from compact.cams.profile import Cam, ProfileTable
from compact.files import atomic_file, write_csv

if TYPE_CHECKING:
    from compact.scene.loader import Scene

MM = 1e3  # [mm/m]


def write_cam_files(
    directory: str | Path, scene: "Scene", cam: Cam, cutter_radius: float | None = None, tolerance: float = MICROMETRE
) -> list[Path]:
    """Write points, drawing as SVG, animation and drawing as DXF of a cam.

    Parameters
    ----------
    directory : str or Path
        Folder of the files.
    scene : Scene
        Scene of the cam.
    cam : Cam
        Cam.
    cutter_radius : float, optional
        Radius of the cutter [m].
    tolerance : float
        Tolerance of the points [m].

    Returns
    -------
    list of Path
        Files written.
    """
    outline = cut(cam, cutter_radius, tolerance)
    drawing = workshop_drawing.workshop_drawing(outline, scene.cam.bore if scene.cam else None)
    table = point_table(outline)
    law, machine = cam.cycle.forward.name, scene.machine
    kind = type(cam.follower).__name__.removesuffix("Follower").removesuffix("Face").lower()
    stem = Path(directory) / f"{law}-{kind}"
    label = f"the cam turns and its followers move the cart with the law {law}"
    motion = animated_svg(cam, machine.roller_radius, machine.roller_positions, label)
    return [
        write_csv(_with_suffix(stem, ".csv"), table.header, table.rows()),
        _write_text(_with_suffix(stem, ".svg"), drawing.svg(workshop_drawing.describe(outline))),
        _write_text(_with_suffix(stem, "-motion.svg"), motion),
        _write_text(_with_suffix(stem, ".dxf"), drawing.dxf()),
    ]


def point_table(cut: Cut) -> ProfileTable:
    """Return every point of a cut: cam angle, follower, profile in both coordinates, cutter; mm and degrees."""
    radius, polar = cut.polar
    header = ["cam_angle_deg", "follower_mm", "x_mm", "y_mm", "radius_mm", "polar_angle_deg"]
    columns = [
        np.degrees(cut.angle),
        MM * cut.cam.radius(cut.angle),
        *MM * cut.profile.T,
        MM * radius,
        np.degrees(polar),
    ]
    if cut.cutter_path is not None:
        header += ["cutter_x_mm", "cutter_y_mm"]
        columns += [*MM * cut.cutter_path.T]
    return ProfileTable(tuple(header), np.array(columns))


def _with_suffix(stem: Path, suffix: str) -> Path:
    return stem.with_name(stem.name + suffix)


def _write_text(path: Path, text: str) -> Path:
    with atomic_file(path) as stream:
        stream.write(text)
    return path
