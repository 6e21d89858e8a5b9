"""Workshop drawing of a cam, its animation and its files.

The drawing is a DXF document of ezdxf in millimetres, x to the right, y up, on the layers of `LAYERS`; its dimensions
are DIMENSION entities, whose number a CAD program measures from the geometry. Its SVG shows the same entities.

Notes
-----
The SVG is written here, not by the drawing add-on of ezdxf. The add-on converts text to outlines of glyphs, so that it
can be neither searched nor read aloud; it loses the names of the layers; and it rounds coordinates to the page width
over 10^6, 2 um on a cam of 1 m, more than the tolerance of the profile. Its files are seven times as large.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from io import StringIO
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from compact.cams.machining import MICROMETRE, Cut, cut, largest_cutter
from compact.cams.profile import Cam, FlatFace, Follower, Pointed
from compact.files import write_bytes, write_columns
from compact.numerics import Array

if TYPE_CHECKING:
    from ezdxf.document import Drawing

    from compact.scene.loader import Scene

MM = 1e3  # [mm/m]
NOTE_COLUMNS = (0, 8, 16)  # [-], columns of the notes, in letters from the left
LINE_SPACING = 1.7  # [-], over the height of a letter
LETTERS_PER_RADIUS = 38  # [-], heights of a letter in the largest radius
COORDINATE_DECIMALS = 6  # [-], of a length in mm: a nanometre
DIMENSION_DECIMALS = 3  # [-], of the number of a dimension in mm: a micrometre
LETTER_WIDTH = 0.85  # [-], of the height of a capital: estimate of the width of text
FONT_SIZE = 1.35  # [-], of the height of a capital, which is 0.74 of the font size
MARGIN = 0.02  # [-], of the larger side of the drawing, left free around it
LINE_TYPE_SCALE = 0.04  # [-], of the largest radius in mm: $LTSCALE of DXF
DIMENSION_LAYER = "DIMENSIONS"
BY_LAYER, NO_TRAILING_ZEROS = 256, 8  # codes of DXF: colour of the layer, DIMZIN
# Sizes of a dimension over the height of its text [-]: text, arrow, extension lines and their offset, gap
DIMENSION_SIZES = MappingProxyType({"dimtxt": 1.0, "dimasz": 0.9, "dimexe": 0.5, "dimexo": 0.4, "dimgap": 0.35})
# Layers: colour in SVG and in DXF (ACI), line width over the width of the drawing [-], dashes and gaps in SVG over the
# line width [-], line type in DXF
LAYERS = MappingProxyType(
    {
        "PROFILE": ("#000000", 7, 1 / 700, "", "CONTINUOUS"),
        "CUTTER": ("#b3261e", 1, 1 / 1400, "8 4", "DASHED"),
        "FOLLOWER": ("#1f5fa8", 5, 1 / 1400, "4 3", "DASHED"),
        "CENTRE": ("#6b6b6b", 8, 1 / 2000, "12 3 2 3", "CENTER"),
        "BORE": ("#000000", 7, 1 / 1000, "", "CONTINUOUS"),
        DIMENSION_LAYER: ("#3a3a3a", 3, 1 / 2000, "", "CONTINUOUS"),
        "NOTES": ("#000000", 7, 1 / 2000, "", "CONTINUOUS"),
    }
)
FRAMES = 72  # [-], instants of a turn in the animation: every five degrees
PROFILE_POINTS = 361  # [-], of the profile in the animation
POINT_RADIUS = 8.0  # [mm], of the circle that shows a pointed follower
CAM_COLOUR, EDGE_COLOUR, MARK_COLOUR, CART_COLOUR, MIX_COLOUR = "#d7e3f0", "#1f3a5f", "#5a6b7b", "#7a4a00", "#c9c2b4"
DISC = f'fill="#f0c987" stroke="{CART_COLOUR}" stroke-width="5"'  # of followers and rollers


# ---- drawing ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class WorkshopDrawing:
    """Drawing of a cam.

    Attributes
    ----------
    document : ezdxf.document.Drawing
        Entities in the model space, lengths and coordinates in mm.
    """

    title: str
    document: "Drawing"

    def dxf(self) -> str:
        """Return the drawing as DXF text, units millimetres."""
        text = StringIO()
        self.document.write(text)
        return text.getvalue()

    def svg(self, description: str = "") -> str:
        """Return the drawing as SVG text with a description, true to scale, one unit a millimetre."""
        found = [_svg_shape(part, entity.dxf.layer) for entity in self.document.modelspace() for part in _parts(entity)]
        corners = np.concatenate([points for points, _ in found])
        low, high = corners.min(axis=0), corners.max(axis=0)
        margin = MARGIN * (high - low).max()
        (left, bottom), (width, height) = low - margin, high - low + 2 * margin
        rules = ["text{fill:#000;font-family:sans-serif}", "polygon,circle,polyline{fill:none}"]
        for name, (colour, _, share, dashes, _) in LAYERS.items():
            line = f"stroke:{colour};stroke-width:{_number(share * width)}"
            if dashes:
                line += f";stroke-dasharray:{' '.join(_number(float(dash) * share * width) for dash in dashes.split())}"
            rules.append(f".{name}{{{line}}}")
        rules += [f"polygon.{DIMENSION_LAYER}{{fill:{LAYERS[DIMENSION_LAYER][0]}}}", "text{stroke:none!important}"]
        words = f'<title id="title">{escape(self.title)}</title><desc id="desc">{escape(description)}</desc>'
        size = f'width="{_number(width)}mm" height="{_number(height)}mm"'
        view = f'viewBox="{_number(left)} {_number(-bottom - height)} {_number(width)} {_number(height)}"'
        head = f'<svg xmlns="http://www.w3.org/2000/svg" {size} {view} role="img" aria-labelledby="title desc">'
        shapes = "\n".join(shape for _, shape in found)
        return f"{head}\n{words}\n<style>{''.join(rules)}</style>\n{shapes}\n</svg>\n"


def _parts(entity: Any) -> Iterator[Any]:
    """Yield the simple entities of an entity: a dimension has lines, text, and arrows, which are blocks."""
    if entity.dxftype() in ("DIMENSION", "INSERT"):
        for part in entity.virtual_entities():
            yield from _parts(part)
    elif entity.dxftype() != "POINT":  # a measured point of a dimension, not drawn
        yield entity


def _svg_shape(entity: Any, layer: str) -> tuple[Array, str]:
    """Corners [mm], shape (n, 2), of the bounding box of a simple entity, and its SVG."""
    kind, dxf = entity.dxftype(), entity.dxf
    if kind == "CIRCLE":
        x, y, _ = dxf.center
        place = f'cx="{_number(x)}" cy="{_number(-y)}" r="{_number(dxf.radius)}"'
        return np.array([[x, y]]) + dxf.radius * np.array([[-1], [1]]), f'<circle class="{layer}" {place}/>'
    if kind in ("TEXT", "MTEXT"):
        words, height = (dxf.text, dxf.height) if kind == "TEXT" else (entity.plain_text(), dxf.char_height)
        (x, y, _), turn, width = dxf.insert, "", LETTER_WIDTH * height * len(words)
        corners = np.array([[x, y], [x + width, y + height]])
        if kind == "MTEXT":  # of a dimension: centred, along its line
            corners = np.array([[x, y]]) + width / 2 * np.array([[-1], [1]])
            turned = f"rotate({_number(-dxf.rotation)} {_number(x)} {_number(-y)})"
            turn = f' text-anchor="middle" dominant-baseline="central" transform="{turned}"'
        place = f'x="{_number(x)}" y="{_number(-y)}" font-size="{_number(FONT_SIZE * height)}"{turn}'
        return corners, f'<text class="{layer}" {place}>{escape(words)}</text>'
    names = {"LINE": ("start", "end"), "SOLID": ("vtx0", "vtx1", "vtx2")}.get(kind, ())
    points = np.array([tuple(dxf.get(name))[:2] for name in names] or entity.get_points("xy"))
    pairs = " ".join(f"{_number(x)},{_number(-y)}" for x, y in points)
    return points, f'<{"polyline" if kind == "LINE" else "polygon"} class="{layer}" points="{pairs}"/>'


def _number(value: float) -> str:
    return f"{value:.{COORDINATE_DECIMALS}f}".rstrip("0").rstrip(".")


def workshop_drawing(cut: Cut, bore: float | None = None) -> WorkshopDrawing:
    """Return the drawing of a cut with its dimensions and a bore of a diameter [m]."""
    import ezdxf  # 0.3 s

    cam, (radius, _) = cut.cam, MM * cut.polar
    if bore is not None and not 0 < bore < 2 * radius.min() / MM:
        raise ValueError(
            f"`bore` must be positive and below {2 * radius.min() / MM:.6g} m, the smallest diameter of the cam, "
            f"got {bore:g} m; use a smaller bore or a broader cam"
        )
    document = ezdxf.new("R2010", setup=["linetypes"], units=ezdxf.units.MM)
    document.header["$LTSCALE"] = LINE_TYPE_SCALE * radius.max()
    for name, (_, colour, _, _, line_type) in LAYERS.items():
        document.layers.add(name, color=colour, linetype=line_type)
    space, letter = document.modelspace(), float(radius.max()) / LETTERS_PER_RADIUS
    _draw_outlines(space, cut, bore, letter)
    _draw_dimensions(space, cut, bore, letter)
    title = f"cam for the law {cam.cycle.forward.name}, {_follower_words(cam.follower)}"
    angles = [(f"{np.degrees(at):.4f}°", f"{MM * float(cam.radius(at)):.4f}", words) for at, words in key_angles(cam)]
    rows = [(title,), (), *((line,) for line in _sizes(cut, bore)), (), ("angle", "follower", "begins"), *angles]
    left, top = MM * float(cut.profile[:, 0].max() + 2 * cam.follower.radius) + 10 * letter, float(radius.max())
    for i, row in enumerate(rows):
        for column, words in zip(NOTE_COLUMNS, row, strict=False):
            place = left + letter * column, top - LINE_SPACING * letter * i
            space.add_text(words, height=letter, dxfattribs={"layer": "NOTES", "insert": place})
    return WorkshopDrawing(title, document)


def _draw_outlines(space: Any, cut: Cut, bore: float | None, letter: float) -> None:
    """Profile, cutter path, pitch curve, base circle, bore and centre lines."""
    cam, r = cut.cam, MM * cut.cam.follower.radius
    polygons, circles = {"PROFILE": cut.profile}, [(0.0, MM * float(np.hypot(*cut.profile.T).min()), "CENTRE")]
    if cut.cutter_path is not None:
        polygons["CUTTER"] = cut.cutter_path
    if bore is not None:
        circles.append((0.0, MM * bore / 2, "BORE"))
    if r:
        polygons["FOLLOWER"] = (cam.radius(cut.angle) * np.array([np.cos(cut.angle), np.sin(cut.angle)])).T
        circles += [(sign * MM * float(cam.radius(at)), r, "FOLLOWER") for sign, at in ((1, 0.0), (-1, np.pi))]
    for layer, points in polygons.items():
        space.add_lwpolyline(np.round(MM * points, COORDINATE_DECIMALS), close=True, dxfattribs={"layer": layer})
    for centre, radius, layer in circles:
        space.add_circle((centre, 0.0), radius, dxfattribs={"layer": layer})
    beyond = 3 * letter + 2 * r
    low, high = MM * cut.profile.min(axis=0) - beyond, MM * cut.profile.max(axis=0) + beyond
    for ends in (((low[0], 0.0), (high[0], 0.0)), ((0.0, low[1]), (0.0, high[1]))):
        space.add_line(*ends, dxfattribs={"layer": "CENTRE"})
    at_zero = {"layer": DIMENSION_LAYER, "insert": (high[0], 0.3 * letter)}
    space.add_text("0°", height=letter, dxfattribs=at_zero)


def _draw_dimensions(space: Any, cut: Cut, bore: float | None, letter: float) -> None:
    """Dimensions of breadth, base circle, largest radius, bore and roller."""
    cam, (radius, _) = cut.cam, MM * cut.polar
    right, left = MM * float(cam.radius(0.0)), -MM * float(cam.radius(np.pi))
    style = {name: share * letter for name, share in DIMENSION_SIZES.items()}
    style |= dict.fromkeys(("dimclrd", "dimclre", "dimclrt"), BY_LAYER)
    style |= {"dimdec": DIMENSION_DECIMALS, "dimdsep": ord("."), "dimzin": NO_TRAILING_ZEROS, "dimtad": 1}
    shared = {"dimstyle": "Standard", "override": style, "dxfattribs": {"layer": DIMENSION_LAYER}}

    def distance(start: Sequence[float], end: Sequence[float], offset: float, prefix: str) -> None:
        space.add_aligned_dim(p1=start, p2=end, distance=offset, text=f"{prefix}<>", **shared).render()

    def size(add: Any, centre: float, radius: float, angle: float) -> None:
        beyond = (radius + 3 * letter) * np.array([np.cos(angle), np.sin(angle)]) + (centre, 0.0)
        add(center=(centre, 0.0), radius=radius, angle=np.degrees(angle), location=tuple(beyond), **shared).render()

    distance((left, 0.0), (right, 0.0), MM * float(cut.profile[:, 1].min()) - 6 * letter, "b = ")
    size(space.add_radius_dim, 0.0, float(radius.min()), np.radians(-110))
    start, end = sorted([(0.0, 0.0), tuple((MM * cut.profile[radius.argmax()]).tolist())])  # text from left to right
    distance(start, end, 4 * letter, "R")
    if bore is not None:
        size(space.add_diameter_dim, 0.0, MM * bore / 2, np.radians(-45))
    if cam.follower.radius:
        size(space.add_radius_dim, right, MM * cam.follower.radius, np.radians(60))


def _sizes(cut: Cut, bore: float | None) -> Iterator[str]:
    """Sizes of the cam, one line each."""
    cam, (radius, _) = cut.cam, MM * cut.polar
    least, cutter, flat = cam.least_breadth(), largest_cutter(cam), isinstance(cam.follower, FlatFace)
    over = "faces" if flat else "points" if isinstance(cam.follower, Pointed) else "roller centres"
    face = f", {MM * cam.largest_contact_offset:.3f} to each side at least" if flat else ""
    yield "lengths in mm, angles counterclockwise from 0°; the cam turns clockwise"
    yield f"tolerance of the follower's travel {MM * cut.tolerance:g}"
    yield f"profile of {len(cut.angle)} points: largest deviation {MM * cut.error:.5f}"
    yield f"breadth b over the {over} {MM * cam.breadth:.3f}"
    yield f"stroke {MM * cam.cycle.forward.stroke:.3f}"
    yield f"base circle: radius {radius.min():.3f}; largest radius {radius.max():.3f}"
    yield "bore: not given" if bore is None else f"bore: diameter {MM * bore:g}"
    yield f"{_follower_words(cam.follower)}{face}"
    if cut.cutter_radius is not None:
        yield f"cutter: radius {MM * cut.cutter_radius:g}, path of its centre dashed red"
    fits = f"cutter radius up to {np.floor(100 * MM * cutter) / 100:.2f}"
    yield "cutter of any radius fits: no concave parts" if np.isinf(cutter) else fits
    yield f"least radius of curvature {MM * cam.least_radius_of_curvature:.3f}"
    yield f"least breadth {MM * least.breadth:.3f}: {least.rule}"
    yield f"largest pressure angle {np.degrees(cam.largest_pressure_angle):.2f}°"


def key_angles(cam: Cam) -> list[tuple[float, str]]:
    """Return (angle [rad], what begins there) of every pass, dwell and breakpoint of the laws, ascending."""
    words, found = {1: "forward stroke", -1: "return stroke"}, {}
    for leg in cam.cycle.legs():
        dwell = "far dwell" if leg.position > 0 else "near dwell"
        for z in leg.breakpoints()[:-1]:
            begins = words.get(leg.direction, dwell) if z == 0 else "next piece of the law"
            found[2 * np.pi * (leg.start + leg.duration * z) / cam.cycle.period] = begins
    return sorted(found.items())


def describe(cut: Cut) -> str:
    """Return a description of a cut in one sentence, for screen readers."""
    radius, _ = MM * cut.polar
    return (
        f"profile of the cam for the law {cut.cam.cycle.forward.name} with {_follower_words(cut.cam.follower)}: radius "
        f"from {radius.min():.1f} to {radius.max():.1f} mm about the axis, breadth {MM * cut.cam.breadth:.1f} mm"
    )


def _follower_words(follower: Follower) -> str:
    if isinstance(follower, FlatFace):
        return "flat-faced followers"
    return "pointed followers" if isinstance(follower, Pointed) else f"rollers of radius {MM * follower.radius:g} mm"


# ---- animation -------------------------------------------------------------------------------------------------------


def animated_svg(cam: Cam, roller_radius: float, roller_positions: Sequence[float], label: str) -> str:
    """Return the animation of a cam and its cart, lengths in m, as SVG text with an escaped label for readers.

    It moves by CSS, without script or network, and is static in print. The cam turns evenly, clockwise, one turn a
    cycle; both followers are in one carriage with the cart, shown next to the cam, whose rollers turn by travel/radius.
    Positions are those of the law at FRAMES instants, linear in between; in millimetres, y down, true to scale.
    """
    angle = np.linspace(0, 2 * np.pi, FRAMES + 1)
    travel = MM * cam.cycle.derivative(angle * cam.cycle.period / (2 * np.pi), 0)
    radius, positions = MM * roller_radius, MM * np.asarray(roller_positions)

    def keyframes(name: str, values: Array, transform: str) -> str:
        stops = (f"{100 * i / FRAMES:.4g}%{{transform:{transform.format(value)}}}" for i, value in enumerate(values))
        return f"@keyframes {name}{{{''.join(stops)}}}"

    style = (
        f".moves{{animation:{cam.cycle.period:g}s linear infinite}}"
        ".cam{animation-name:turn}.carriage{animation-name:travel}.roller{animation-name:roll}"
        "@keyframes turn{to{transform:rotate(360deg)}}"
        f"{keyframes('travel', travel, 'translateX({:.3f}px)')}"
        f"{keyframes('roll', np.degrees(travel / radius), 'rotate({:.3f}deg)')}"
        "@media print,(prefers-reduced-motion:reduce){.moves{animation:none}}"
    )
    x, y = MM * cam.profile(np.linspace(0, 2 * np.pi, PROFILE_POINTS))
    largest, stroke = np.hypot(x, y).max(), MM * cam.cycle.forward.stroke
    near, far, rail = MM * float(cam.radius(0.0)), -MM * float(cam.radius(np.pi)), -1.1 * largest
    axles = near + largest + stroke + positions.max() - positions.min() + positions - positions.mean()
    left, right = axles.min() - radius, axles.max() + radius + stroke  # of the mix under the rollers
    box = f"{far - 0.1 * largest:.1f} {1.05 * rail:.1f} {right - far + 0.2 * largest:.1f} {2.15 * largest:.1f}"
    points = " ".join(f"{each:.2f},{-across:.2f}" for each, across in zip(x, y, strict=True))
    bar = f'stroke="{CART_COLOUR}" stroke-width="10" fill="none"'
    spoke = f'<line x1="0" y1="0" x2="{radius:.1f}" y2="0" stroke="{CART_COLOUR}" stroke-width="5"/>'
    wheel = f'<g class="moves roller"><circle r="{radius:.1f}" {DISC}/>{spoke}</g>'
    wheels = "".join(f'<g transform="translate({axle:.1f} 0)">{wheel}</g>' for axle in axles)
    reach, disc = MM * cam.largest_contact_offset, f'r="{MM * cam.follower.radius or POINT_RADIUS:.1f}" {DISC}'
    followers = "".join(
        f'<path d="M{at:.1f},{-reach:.1f}V{reach:.1f}" {bar}/>'
        if isinstance(cam.follower, FlatFace)
        else f'<circle cx="{at:.1f}" cy="0" {disc}/>'
        for at in (far, near)
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{box}" role="img" aria-label="{label}">'
        f"<style>{style}</style>"
        f'<rect x="{left:.1f}" y="{radius:.1f}" width="{right - left:.1f}" height="{0.3 * largest:.1f}" '
        f'fill="{MIX_COLOUR}"/><g class="moves cam">'
        f'<polygon points="{points}" fill="{CAM_COLOUR}" stroke="{EDGE_COLOUR}" stroke-width="5"/>'
        f'<path d="M0,0H{0.8 * np.hypot(x[0], y[0]):.1f}" stroke="{MARK_COLOUR}" stroke-width="6"/>'
        f'<circle r="{0.04 * largest:.1f}" fill="{EDGE_COLOUR}"/></g><g class="moves carriage">'
        f'<path d="M{far:.1f},0V{rail:.1f}H{near:.1f}V0H{axles.max():.1f}" {bar}/>{followers}{wheels}</g></svg>\n'
    )


# ---- files -----------------------------------------------------------------------------------------------------------


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
    outline, law, machine = cut(cam, cutter_radius, tolerance), cam.cycle.forward.name, scene.machine
    drawing, table = workshop_drawing(outline, scene.cam.bore if scene.cam else None), point_table(outline)
    name = f"{law}-{type(cam.follower).__name__.removesuffix('Follower').removesuffix('Face').lower()}"
    label = f"the cam turns and its followers move the cart with the law {law}"
    texts = {
        ".svg": drawing.svg(describe(outline)),
        "-motion.svg": animated_svg(cam, machine.roller_radius, machine.roller_positions, label),
        ".dxf": drawing.dxf(),
    }
    points = write_columns(Path(directory) / f"{name}.csv", tuple(table), tuple(table.values()))
    drawn = [write_bytes(Path(directory) / f"{name}{ending}", text.encode()) for ending, text in texts.items()]
    return [points, *drawn]


def point_table(cut: Cut) -> dict[str, Array]:
    """Return every point of a cut: cam angle, follower, profile in both coordinates, cutter; mm and degrees."""
    (x, y), (radius, polar) = MM * cut.profile.T, cut.polar
    columns = {
        "cam_angle_deg": np.degrees(cut.angle), "follower_mm": MM * cut.cam.radius(cut.angle), "x_mm": x, "y_mm": y,
        "radius_mm": MM * radius, "polar_angle_deg": np.degrees(polar),
    }  # fmt: skip
    if cut.cutter_path is not None:
        columns["cutter_x_mm"], columns["cutter_y_mm"] = MM * cut.cutter_path.T
    return columns
