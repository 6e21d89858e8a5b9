"""What `compact cam` writes: points as CSV, drawings as SVG and DXF in millimetres, and the cam in motion."""

from pathlib import Path

from compact import cam_sheet
from compact.cam_motion import moving
from compact.cutting import cut
from compact.results import whole_file, write_csv


def write(directory, scene, cam, cutter_radius=None, tolerance=1e-6):
    """Write a `Cam` of a scene for a cutter [m] to a tolerance [m]; the paths, the DXF last.

    Raises ValueError where it cannot be cut so.
    """
    made = cut(cam, cutter_radius, tolerance)
    drawing = cam_sheet.sheet(made, scene.cam.bore)
    kind = type(cam.follower).__name__.removesuffix("Follower").removesuffix("Face").lower()
    stem = Path(directory) / f"{cam.cycle.there.name}-{kind}"
    table = cam_sheet.points(made)
    paths = [write_csv(_named(stem, ".csv"), table.header, table.rows())]
    paths.append(_text(_named(stem, ".svg"), drawing.svg(cam_sheet.described(made))))
    machine = scene.machine
    words = f"the cam turns and its followers carry the cart through the law {cam.cycle.there.name}"
    motion = moving(cam, machine.roller_radius, machine.roller_positions, words)
    paths.append(_text(_named(stem, "-motion.svg"), motion))
    paths.append(_text(_named(stem, ".dxf"), drawing.dxf()))
    return paths


def _named(stem, ending):
    return stem.with_name(stem.name + ending)


def _text(path, text):
    with whole_file(path) as stream:
        stream.write(text)
    return path
