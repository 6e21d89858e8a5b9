"""What `compact cam` writes: points as CSV, drawings as SVG and DXF in millimetres, and the cam in motion.

A cam and its cart in motion, as one SVG that moves by itself: no script, no network, still in print.

The cam turns evenly, clockwise, a turn in the period of the cycle; both followers stand in one carriage, the cart hangs
on it, and its rollers turn by travel/radius. Positions are the law's at FRAMES instants, straight in between. Drawn in
millimetres, y down; the cart is moved beside the cam, else all is to scale.
"""

from pathlib import Path

import numpy as np

from compact.cams import workshop_drawing
from compact.cams.machining import cut
from compact.cams.profile import FlatFace, Pointed
from compact.files import atomic_file, write_csv


def write_cam_files(directory, scene, cam, cutter_radius=None, tolerance=1e-6):
    """Write a `Cam` of a scene for a cutter [m] to a tolerance [m]; the paths, the DXF last.

    Raises ValueError where it cannot be cut so.
    """
    made = cut(cam, cutter_radius, tolerance)
    drawing = workshop_drawing.sheet(made, scene.cam.bore)
    kind = type(cam.follower).__name__.removesuffix("Follower").removesuffix("Face").lower()
    stem = Path(directory) / f"{cam.cycle.there.name}-{kind}"
    table = workshop_drawing.points(made)
    paths = [write_csv(_named(stem, ".csv"), table.header, table.rows())]
    paths.append(_text(_named(stem, ".svg"), drawing.svg(workshop_drawing.described(made))))
    machine = scene.machine
    words = f"the cam turns and its followers carry the cart through the law {cam.cycle.there.name}"
    motion = moving(cam, machine.roller_radius, machine.roller_positions, words)
    paths.append(_text(_named(stem, "-motion.svg"), motion))
    paths.append(_text(_named(stem, ".dxf"), drawing.dxf()))
    return paths


def _named(stem, ending):
    return stem.with_name(stem.name + ending)


def _text(path, text):
    with atomic_file(path) as stream:
        stream.write(text)
    return path


FRAMES = 72  # instants of a turn: every five degrees
MM = 1e3
POINTS = 361  # of the profile as drawn


def moving(cam, roller_radius, roller_positions, words):
    """SVG text of a `Cam` that moves a cart on rollers of a radius at positions [m]; `words` for who cannot see it."""
    angle = np.linspace(0, 2 * np.pi, FRAMES + 1)
    travel = MM * cam.cycle.derivative(angle * cam.cycle.period / (2 * np.pi), 0)
    turned = np.degrees(travel / (MM * roller_radius))
    drawn = _Scene(cam, MM * roller_radius, MM * np.asarray(roller_positions))
    left, top, wide, high = drawn.box()
    style = "".join(
        [
            f".moves{{animation:{cam.cycle.period:g}s linear infinite}}",
            ".cam{animation-name:turn}.carriage{animation-name:travel}.roller{animation-name:roll}",
            "@keyframes turn{to{transform:rotate(360deg)}}",
            _keyframes("travel", travel, "translateX({:.3f}px)"),
            _keyframes("roll", turned, "rotate({:.3f}deg)"),
            "@media print,(prefers-reduced-motion:reduce){.moves{animation:none}}",
        ]
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{left:.1f} {top:.1f} {wide:.1f} {high:.1f}" role="img" '
        f'aria-label="{words}"><style>{style}</style>{drawn.still()}{drawn.cam_group()}{drawn.carriage()}</svg>\n'
    )


def _keyframes(name, values, transform):
    """Stops of a CSS animation, evenly over its time."""
    stops = (f"{100 * i / FRAMES:.4g}%{{transform:{transform.format(value)}}}" for i, value in enumerate(values))
    return f"@keyframes {name}{{{''.join(stops)}}}"


class _Scene:
    """Where things stand at the angle 0, in mm with y down."""

    def __init__(self, cam, radius, positions):
        self.cam, self.radius = cam, radius
        x, y = MM * cam.profile(np.linspace(0, 2 * np.pi, POINTS))
        self.profile, self.greatest = np.array([x, -y]).T, np.hypot(x, y).max()
        self.stroke = MM * cam.cycle.there.stroke
        self.near, self.far = MM * float(cam.radius(0.0)), -MM * float(cam.radius(np.pi))
        self.middle = self.near + self.greatest + self.stroke + positions.max() - positions.min()
        self.axles = self.middle + positions - positions.mean()
        self.rail = -1.1 * self.greatest

    def box(self):
        """Left, top, width and height of all places that anything comes to."""
        left = self.far - 0.1 * self.greatest
        right = self.axles.max() + self.radius + self.stroke + 0.1 * self.greatest
        return left, 1.05 * self.rail, right - left, 2.15 * self.greatest

    def still(self):
        """The mix under the rollers."""
        left, right = self.axles.min() - self.radius, self.axles.max() + self.radius + self.stroke
        size = f'width="{right - left:.1f}" height="{0.3 * self.greatest:.1f}"'
        return f'<rect x="{left:.1f}" y="{self.radius:.1f}" {size} fill="#c9c2b4"/>'

    def cam_group(self):
        """The cam, its axis and a mark by which its turning is seen."""
        points = " ".join(f"{x:.2f},{y:.2f}" for x, y in self.profile)
        mark = f'<path d="M0,0H{0.8 * np.hypot(*self.profile[0]):.1f}" stroke="#5a6b7b" stroke-width="6"/>'
        outline = f'<polygon points="{points}" fill="#d7e3f0" stroke="#1f3a5f" stroke-width="5"/>'
        return f'<g class="moves cam">{outline}{mark}<circle r="{0.04 * self.greatest:.1f}" fill="#1f3a5f"/></g>'

    def carriage(self):
        """Followers, the bar that joins them, and the cart with its rollers."""
        bar = 'stroke="#7a4a00" stroke-width="10" fill="none"'
        ends = "".join(self._follower(x, bar) for x in (self.far, self.near))
        frame = f'<path d="M{self.far:.1f},0V{self.rail:.1f}H{self.near:.1f}V0H{self.axles.max():.1f}" {bar}/>'
        return f'<g class="moves carriage">{frame}{ends}{"".join(self._roller(x) for x in self.axles)}</g>'

    def _follower(self, x, bar):
        if isinstance(self.cam.follower, FlatFace):
            reach = MM * self.cam.largest_contact_offset
            return f'<path d="M{x:.1f},{-reach:.1f}V{reach:.1f}" {bar}/>'
        radius = 8.0 if isinstance(self.cam.follower, Pointed) else MM * self.cam.follower.radius
        return f'<circle cx="{x:.1f}" cy="0" r="{radius:.1f}" fill="#f0c987" stroke="#7a4a00" stroke-width="5"/>'

    def _roller(self, x):
        spoke = f'<line x1="0" y1="0" x2="{self.radius:.1f}" y2="0" stroke="#7a4a00" stroke-width="5"/>'
        disc = f'<circle r="{self.radius:.1f}" fill="#f0c987" stroke="#7a4a00" stroke-width="5"/>'
        return f'<g transform="translate({x:.1f} 0)"><g class="moves roller">{disc}{spoke}</g></g>'
