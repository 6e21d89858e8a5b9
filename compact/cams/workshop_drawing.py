"""Workshop drawing of a cam: outlines, dimensions, sizes, key angles and a table of points. Millimetres."""

from collections.abc import Iterator, Sequence

import numpy as np

from compact.cams import drawing
from compact.cams.machining import Cut, largest_cutter
from compact.cams.profile import Cam, FlatFace, Follower, Pointed, breadth_for_pressure_angle

MM = 1e3  # [mm/m]
TABLE_ROWS = 36  # [-], of the table of points on the drawing, at equal cam angles
TABLE_COLUMNS = (0, 5, 12, 19)  # [-], columns of the table of points, in letters from its left
TABLE_WIDTH = 26  # [-], of half the table, in letters
NOTE_COLUMNS = (0, 8, 16)  # [-], columns of the notes, in letters from the left
LINE_SPACING = 1.7  # [-], over the height of a letter
LETTERS_PER_RADIUS = 38  # [-], heights of a letter in the largest radius
GUIDE_PRESSURE_ANGLE = np.radians(30.0)  # [rad], at which a sliding follower does not jam; rule of thumb

Row = Sequence[str]


def workshop_drawing(cut: Cut, bore: float | None = None) -> drawing.Drawing:
    """Return the drawing of a cut with its dimensions and a bore of a diameter [m]."""
    _require_rim(cut, bore)
    cam = cut.cam
    largest = MM * float(np.hypot(*cut.profile.T).max())
    letter = largest / LETTERS_PER_RADIUS
    title = f"cam for the law {cam.cycle.forward.name}, {_follower_words(cam.follower)}"
    shapes = [*_outlines(cut, bore, letter), *_dimensions(cut, bore, letter)]
    left = MM * float(cut.profile[:, 0].max() + 2 * getattr(cam.follower, "radius", 0.0)) + 10 * letter
    angles = [
        (f"{np.degrees(angle):.4f}°", f"{MM * float(cam.radius(angle)):.4f}", words) for angle, words in key_angles(cam)
    ]
    notes = [(title,), (), *_sizes(cut, bore), (), ("angle", "follower", "begins"), *angles, ()]
    shapes += _text_rows(notes, left, largest, letter, NOTE_COLUMNS)
    below = largest - LINE_SPACING * letter * len(notes)
    for half, points in enumerate(np.array_split(_point_rows(cut), 2)):
        rows = [("angle", "follower", "radius", "at angle"), *points]
        shapes += _text_rows(rows, left + TABLE_WIDTH * letter * half, below, 0.9 * letter, TABLE_COLUMNS)
    return drawing.Drawing(title, tuple(shapes))


def describe(cut: Cut) -> str:
    """Return a description of a cut in one sentence, for screen readers."""
    radius, _ = MM * cut.polar
    return (
        f"profile of the cam for the law {cut.cam.cycle.forward.name} with {_follower_words(cut.cam.follower)}: radius "
        f"from {radius.min():.1f} to {radius.max():.1f} mm about the axis, breadth {MM * cut.cam.breadth:.1f} mm"
    )


def key_angles(cam: Cam) -> list[tuple[float, str]]:
    """Return (angle [rad], what begins there) of every pass, dwell and breakpoint of the laws, ascending."""
    period, words = cam.cycle.period, {1: "forward stroke", -1: "return stroke"}
    found = {}
    for leg in cam.cycle.legs():
        for inner in leg.breakpoints()[1:-1]:
            found[2 * np.pi * (leg.start + leg.duration * inner) / period] = "next piece of the law"
        dwell = "far dwell" if leg.position > 0 else "near dwell"
        found[2 * np.pi * leg.start / period] = words.get(leg.direction, dwell)
    return sorted(found.items())


def _require_rim(cut: Cut, bore: float | None) -> None:
    smallest = float(np.hypot(*cut.profile.T).min())
    if bore is not None and not 0 < bore < 2 * smallest:
        raise ValueError(
            f"`bore` must be positive and below {2 * smallest:.6g} m, the smallest diameter of the cam, got {bore:g} m;"
            " use a smaller bore or a broader cam"
        )


def _follower_words(follower: Follower) -> str:
    if isinstance(follower, FlatFace):
        return "flat-faced followers"
    return "pointed followers" if isinstance(follower, Pointed) else f"rollers of radius {MM * follower.radius:g} mm"


def _outlines(cut: Cut, bore: float | None, letter: float) -> Iterator[drawing.Shape]:
    """Profile, cutter path, pitch curve, base circle, bore and centre lines."""
    cam = cut.cam
    yield drawing.Polygon(MM * cut.profile, "PROFILE")
    if cut.cutter_path is not None:
        yield drawing.Polygon(MM * cut.cutter_path, "CUTTER")
    if not isinstance(cam.follower, FlatFace | Pointed):
        ray = np.array([np.cos(cut.angle), np.sin(cut.angle)])
        yield drawing.Polygon((MM * cam.radius(cut.angle) * ray).T, "FOLLOWER")
        for side in (0.0, np.pi):
            yield drawing.Circle(
                (MM * float(cam.radius(side)) * np.cos(side), 0.0), MM * cam.follower.radius, "FOLLOWER"
            )
    yield drawing.Circle((0.0, 0.0), MM * float(np.hypot(*cut.profile.T).min()), "CENTRE")
    if bore is not None:
        yield drawing.Circle((0.0, 0.0), MM * bore / 2, "BORE")
    beyond = 3 * letter + 2 * MM * getattr(cam.follower, "radius", 0.0)
    low, high = MM * cut.profile.min(axis=0) - beyond, MM * cut.profile.max(axis=0) + beyond
    yield drawing.Line((low[0], 0.0), (high[0], 0.0), "CENTRE")
    yield drawing.Line((0.0, low[1]), (0.0, high[1]), "CENTRE")
    yield drawing.Text((high[0], 0.3 * letter), "0°", letter, drawing.DIMENSION_LAYER)


def _dimensions(cut: Cut, bore: float | None, letter: float) -> Iterator[drawing.Shape]:
    """Dimensions of breadth, base circle, largest radius, bore and roller."""
    cam, (radius, _) = cut.cam, cut.polar
    right, left = MM * float(cam.radius(0.0)), -MM * float(cam.radius(np.pi))
    below = MM * cut.profile[:, 1].min() - 6 * letter
    yield drawing.DistanceDimension((left, 0.0), (right, 0.0), below, letter, "b = ")
    yield drawing.RadiusDimension((0.0, 0.0), MM * float(radius.min()), np.radians(-110), letter)
    start, end = sorted([(0.0, 0.0), tuple((MM * cut.profile[radius.argmax()]).tolist())])  # text from left to right
    yield drawing.DistanceDimension(start, end, 4 * letter, letter, "R")
    if bore is not None:
        yield drawing.RadiusDimension((0.0, 0.0), MM * bore / 2, np.radians(-45), letter, diameter=True)
    if not isinstance(cam.follower, FlatFace | Pointed):
        yield drawing.RadiusDimension((right, 0.0), MM * cam.follower.radius, np.radians(60), letter)


def _sizes(cut: Cut, bore: float | None) -> list[Row]:
    """Sizes of the cam, one row each."""
    cam, (radius, _), flat = cut.cam, cut.polar, isinstance(cut.cam.follower, FlatFace)
    least, guide = cam.least_breadth(), breadth_for_pressure_angle(cam.cycle, cam.follower, GUIDE_PRESSURE_ANGLE)
    over = "faces" if flat else "points" if isinstance(cam.follower, Pointed) else "roller centres"
    face = f", {MM * cam.largest_contact_offset:.3f} to each side at least" if flat else ""
    lines = [
        "lengths in mm, angles counterclockwise from 0°; the cam turns clockwise",
        f"tolerance of the follower's travel {MM * cut.tolerance:g}",
        f"profile of {len(cut.angle)} points: largest deviation {MM * cut.error:.5f}",
        f"breadth b over the {over} {MM * cam.breadth:.3f}",
        f"stroke {MM * cam.cycle.forward.stroke:.3f}",
        f"base circle: radius {MM * radius.min():.3f}; largest radius {MM * radius.max():.3f}",
        "bore: not given" if bore is None else f"bore: diameter {MM * bore:g}",
        f"{_follower_words(cam.follower)}{face}",
        *_cutter_lines(cut),
        f"least radius of curvature {MM * cam.least_radius_of_curvature:.3f}",
        f"least breadth {MM * least.breadth:.3f}: {least.rule}",
        f"largest pressure angle {np.degrees(cam.largest_pressure_angle):.2f}°",
    ]
    within = f"pressure angle within {np.degrees(GUIDE_PRESSURE_ANGLE):g}° from b = {MM * guide:.1f}"
    return [(line,) for line in (lines if flat else [*lines, within])]


def _cutter_lines(cut: Cut) -> Iterator[str]:
    if cut.cutter_radius is not None:
        yield f"cutter: radius {MM * cut.cutter_radius:g}, path of its centre dashed red"
    limit = largest_cutter(cut.cam)
    yield (
        "cutter of any radius fits: no concave parts"
        if np.isinf(limit)
        else f"cutter radius up to {np.floor(100 * MM * limit) / 100:.2f}"
    )


def _point_rows(cut: Cut) -> list[Row]:
    """Points of the profile at equal cam angles."""
    cam, angle = cut.cam, np.linspace(0, 2 * np.pi, TABLE_ROWS, endpoint=False)
    x, y = cam.profile(angle)
    polar = np.degrees(np.arctan2(y, x)) % 360
    columns = (np.degrees(angle), MM * cam.radius(angle), MM * np.hypot(x, y), polar)
    return [
        (f"{a:.0f}°", f"{rho:.4f}", f"{radius:.4f}", f"{at:.4f}°") for a, rho, radius, at in zip(*columns, strict=True)
    ]


def _text_rows(
    rows: Sequence[Row], left: float, top: float, letter: float, columns: Sequence[float]
) -> list[drawing.Text]:
    """Rows of text, their parts at `columns`, in letters from the left."""
    return [
        drawing.Text((left + letter * start, top - LINE_SPACING * letter * i), part, letter)
        for i, row in enumerate(rows)
        for start, part in zip(columns, row, strict=False)
    ]
