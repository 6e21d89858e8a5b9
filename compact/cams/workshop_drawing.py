"""The workshop's sheet of a cam: drawing with sizes, angles and points, and the points as a table. Millimetres."""

import numpy as np

from compact.cams.drawing import Circle, Distance, Drawing, Line, Outline, Radius, Words
from compact.cams.machining import largest_cutter
from compact.cams.profile import FlatFace, Pointed, Table, breadth_for_pressure_angle

MM = 1e3  # millimetres in a metre
ROWS = 36  # of the table of points on the drawing, equal angles of the cam; joins come besides
GENTLE = np.radians(30.0)  # pressure angle that a sliding follower bears without jamming, a rule of thumb


def points(cut):
    """`Table` of every point of a `Cut`: cam angle, follower, profile in both coordinates, cutter; mm and degrees."""
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
    return Table(tuple(header), np.array(columns))


def sheet(cut, bore=None):
    """The `Drawing` of a `Cut` with the dimensions of the workshop; `bore` is the shaft's diameter [m].

    Raises ValueError where the bore leaves no rim.
    """
    cam = cut.cam
    greatest = MM * float(np.hypot(*cut.profile.T).max())
    _refuse_large_bore(cut, bore)
    letter = greatest / 38
    title = f"cam for the law {cam.cycle.forward.name}, {_kind(cam.follower)}"
    shapes = [*_lines(cut, bore, letter), *_dimensions(cut, bore, letter)]
    left = MM * float(cut.profile[:, 0].max() + 2 * getattr(cam.follower, "radius", 0.0)) + 10 * letter
    notes = [(title,), (), *_sizes(cut, bore), (), *_angles(cam), ()]
    shapes += _rows(notes, left, greatest, letter, (0, 8, 16))
    below = greatest - 1.7 * letter * len(notes)
    for half, listed in enumerate(np.array_split(_listed(cut), 2)):
        rows = [("angle", "follower", "radius", "at angle"), *listed]
        shapes += _rows(rows, left + 26 * letter * half, below, 0.9 * letter, (0, 5, 12, 19))
    return Drawing(title, tuple(shapes))


def described(cut):
    """A `Cut` in a sentence, for those who cannot see its drawing."""
    radius, _ = MM * cut.polar
    return (
        f"profile of the cam for the law {cut.cam.cycle.forward.name} with {_kind(cut.cam.follower)}: radius from "
        f"{radius.min():.1f} to {radius.max():.1f} mm about the axis, breadth {MM * cut.cam.breadth:.1f} mm"
    )


def _refuse_large_bore(cut, bore):
    base = float(np.hypot(*cut.profile.T).min())
    if bore is not None and not 0 < bore < 2 * base:
        raise ValueError(
            f"`bore` must be positive and below {2 * base:.6g} m, the smallest diameter of the cam, got {bore:g} m"
        )


def _kind(follower):
    if isinstance(follower, FlatFace):
        return "flat-faced followers"
    return "pointed followers" if isinstance(follower, Pointed) else f"rollers of radius {MM * follower.radius:g} mm"


def _lines(cut, bore, letter):
    """Profile, cutter, path of the follower's centre, base circle, bore, centre lines."""
    cam = cut.cam
    yield Outline(MM * cut.profile, "PROFILE")
    if cut.cutter_path is not None:
        yield Outline(MM * cut.cutter_path, "CUTTER")
    if not isinstance(cam.follower, FlatFace | Pointed):
        ray = np.array([np.cos(cut.angle), np.sin(cut.angle)])
        yield Outline((MM * cam.radius(cut.angle) * ray).T, "FOLLOWER")
        for side in (0.0, np.pi):
            yield Circle((MM * float(cam.radius(side)) * np.cos(side), 0.0), MM * cam.follower.radius, "FOLLOWER")
    yield Circle((0.0, 0.0), MM * float(np.hypot(*cut.profile.T).min()), "CENTRE")
    if bore is not None:
        yield Circle((0.0, 0.0), MM * bore / 2, "BORE")
    beyond = 3 * letter + 2 * MM * getattr(cam.follower, "radius", 0.0)
    low, high = MM * cut.profile.min(axis=0) - beyond, MM * cut.profile.max(axis=0) + beyond
    yield Line((low[0], 0.0), (high[0], 0.0), "CENTRE")
    yield Line((0.0, low[1]), (0.0, high[1]), "CENTRE")
    yield Words((high[0], 0.3 * letter), "0°", letter, "DIMENSIONS")


def _dimensions(cut, bore, letter):
    """Breadth, base circle, largest radius, bore and roller, as dimensions."""
    cam, (radius, _) = cut.cam, cut.polar
    right, left = MM * float(cam.radius(0.0)), -MM * float(cam.radius(np.pi))
    below = MM * cut.profile[:, 1].min() - 6 * letter
    yield Distance((left, 0.0), (right, 0.0), below, letter, "b = ")
    yield Radius((0.0, 0.0), MM * float(radius.min()), np.radians(-110), letter)
    ends = sorted([(0.0, 0.0), tuple((MM * cut.profile[radius.argmax()]).tolist())])  # words from left to right
    yield Distance(*ends, 4 * letter, letter, "R")
    if bore is not None:
        yield Radius((0.0, 0.0), MM * bore / 2, np.radians(-45), letter, twice=True)
    if not isinstance(cam.follower, FlatFace | Pointed):
        yield Radius((right, 0.0), MM * cam.follower.radius, np.radians(60), letter)


def _sizes(cut, bore):
    """The sizes in words, a row each."""
    cam, (radius, _), flat = cut.cam, cut.polar, isinstance(cut.cam.follower, FlatFace)
    least, gentle = cam.least_breadth(), breadth_for_pressure_angle(cam.cycle, cam.follower, GENTLE)
    over = "faces" if flat else "points" if isinstance(cam.follower, Pointed) else "roller centres"
    lines = [
        "lengths in mm, angles counterclockwise from 0°; the cam turns clockwise",
        f"tolerance of the follower's travel {MM * cut.tolerance:g}",
        f"profile of {len(cut.angle)} points keeps it within {MM * cut.error:.5f}",
        f"breadth b over the {over} {MM * cam.breadth:.3f}",
        f"stroke {MM * cam.cycle.forward.stroke:.3f}",
        f"base circle: radius {MM * radius.min():.3f}; largest radius {MM * radius.max():.3f}",
        "bore: not given" if bore is None else f"bore: diameter {MM * bore:g}",
        f"{_kind(cam.follower)}" + (f", {MM * cam.largest_contact_offset:.3f} to each side at least" if flat else ""),
        *_cutter(cut),
        f"least radius of curvature {MM * cam.least_radius_of_curvature:.3f}",
        f"least breadth {MM * least.breadth:.3f}: {least.rule}",
        f"largest pressure angle {np.degrees(cam.largest_pressure_angle):.2f}°",
    ]
    within = f"pressure angle within {np.degrees(GENTLE):g}° from b = {MM * gentle:.1f} on"
    return [(line,) for line in (lines if flat else [*lines, within])]


def _cutter(cut):
    if cut.cutter_radius is not None:
        yield f"cutter: radius {MM * cut.cutter_radius:g}, path of its centre dashed red"
    limit = largest_cutter(cut.cam)
    yield (
        "any cutter fits: there are no hollows"
        if np.isinf(limit)
        else f"cutters fit up to radius {np.floor(100 * MM * limit) / 100:.2f}"
    )


def key_angles(cam):
    """(angle [rad], what begins there) for every pass, dwell and join of the law, rising."""
    period, words = cam.cycle.period, {1: "the way out begins", -1: "the way back begins"}
    found = {}
    for leg in cam.cycle.legs():
        for inner in leg.breakpoints()[1:-1]:
            found[2 * np.pi * (leg.start + leg.duration * inner) / period] = "pieces of the law join"
        stands = "stands at the far end" if leg.position > 0 else "stands at the near end"
        found[2 * np.pi * leg.start / period] = words.get(leg.direction, stands)
    return sorted(found.items())


def _angles(cam):
    rows = [("angle", "follower", "what begins")]
    for angle, what in key_angles(cam):
        rows.append((f"{np.degrees(angle):.4f}°", f"{MM * float(cam.radius(angle)):.4f}", what))
    return rows


def _listed(cut):
    """Points of the profile at equal angles of the cam, as rows of words."""
    cam, angle = cut.cam, np.linspace(0, 2 * np.pi, ROWS, endpoint=False)
    x, y = cam.profile(angle)
    polar = np.degrees(np.arctan2(y, x)) % 360
    columns = (np.degrees(angle), MM * cam.radius(angle), MM * np.hypot(x, y), polar)
    return [
        (f"{a:.0f}°", f"{rho:.4f}", f"{radius:.4f}", f"{at:.4f}°") for a, rho, radius, at in zip(*columns, strict=True)
    ]


def _rows(rows, left, top, letter, columns):
    """Rows of words below one another, their parts at `columns`, in letters from the left."""
    return [
        Words((left + letter * start, top - 1.7 * letter * i), part, letter)
        for i, row in enumerate(rows)
        for start, part in zip(columns, row, strict=False)
    ]
