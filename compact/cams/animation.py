"""Animation of a cam and its cart as one SVG with CSS, without script or network; static in print.

The cam turns evenly, clockwise, one turn a cycle; both followers are in one carriage with the cart, whose rollers turn
by travel/radius. Positions are those of the law at FRAMES instants, linear in between. Drawn in millimetres, y down,
true to scale; the cart is shown next to the cam.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from compact.cams.followers import FlatFace, Pointed
from compact.cams.profile import Cam
from compact.numerics import Array

MM = 1e3  # [mm/m]
FRAMES = 72  # [-], instants of a turn: every five degrees
PROFILE_POINTS = 361  # [-], of the profile as drawn
POINT_RADIUS = 8.0  # [mm], of the circle that shows a pointed follower
COLOURS = {"cam": "#d7e3f0", "edge": "#1f3a5f", "mark": "#5a6b7b", "cart": "#7a4a00", "roller": "#f0c987"}
MIX_COLOUR = "#c9c2b4"


def animated_svg(cam: Cam, roller_radius: float, roller_positions: Sequence[float], label: str) -> str:
    """Return the animation of a cam and its cart, lengths in m, as SVG text with an escaped label for readers."""
    angle = np.linspace(0, 2 * np.pi, FRAMES + 1)
    travel = MM * cam.cycle.derivative(angle * cam.cycle.period / (2 * np.pi), 0)
    rotation = np.degrees(travel / (MM * roller_radius))
    geometry = _Geometry(cam, MM * roller_radius, MM * np.asarray(roller_positions))
    left, top, width, height = geometry.bounding_box()
    style = "".join(
        [
            f".moves{{animation:{cam.cycle.period:g}s linear infinite}}",
            ".cam{animation-name:turn}.carriage{animation-name:travel}.roller{animation-name:roll}",
            "@keyframes turn{to{transform:rotate(360deg)}}",
            _keyframes("travel", travel, "translateX({:.3f}px)"),
            _keyframes("roll", rotation, "rotate({:.3f}deg)"),
            "@media print,(prefers-reduced-motion:reduce){.moves{animation:none}}",
        ]
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{left:.1f} {top:.1f} {width:.1f} {height:.1f}" role="img" '
        f'aria-label="{label}"><style>{style}</style>{geometry.mix()}{geometry.cam_group()}{geometry.carriage()}</svg>\n'
    )


def _keyframes(name: str, values: Iterable[float], transform: str) -> str:
    """Keyframes of a CSS animation, evenly over its time."""
    stops = (f"{100 * i / FRAMES:.4g}%{{transform:{transform.format(value)}}}" for i, value in enumerate(values))
    return f"@keyframes {name}{{{''.join(stops)}}}"


class _Geometry:
    """Geometry of cam, carriage and cart at the angle 0, in mm with y down."""

    def __init__(self, cam: Cam, radius: float, positions: Array) -> None:
        self.cam, self.radius = cam, radius
        x, y = MM * cam.profile(np.linspace(0, 2 * np.pi, PROFILE_POINTS))
        self.profile, self.largest = np.array([x, -y]).T, np.hypot(x, y).max()
        self.stroke = MM * cam.cycle.forward.stroke
        self.near, self.far = MM * float(cam.radius(0.0)), -MM * float(cam.radius(np.pi))
        self.middle = self.near + self.largest + self.stroke + positions.max() - positions.min()
        self.axles = self.middle + positions - positions.mean()
        self.rail = -1.1 * self.largest

    def bounding_box(self) -> tuple[float, float, float, float]:
        """Left, top, width and height of all places that anything reaches."""
        left = self.far - 0.1 * self.largest
        right = self.axles.max() + self.radius + self.stroke + 0.1 * self.largest
        return left, 1.05 * self.rail, right - left, 2.15 * self.largest

    def mix(self) -> str:
        """Mix under the rollers."""
        left, right = self.axles.min() - self.radius, self.axles.max() + self.radius + self.stroke
        size = f'width="{right - left:.1f}" height="{0.3 * self.largest:.1f}"'
        return f'<rect x="{left:.1f}" y="{self.radius:.1f}" {size} fill="{MIX_COLOUR}"/>'

    def cam_group(self) -> str:
        """Cam with its axis and a mark that shows its rotation."""
        points = " ".join(f"{x:.2f},{y:.2f}" for x, y in self.profile)
        end = f"{0.8 * np.hypot(*self.profile[0]):.1f}"
        mark = f'<path d="M0,0H{end}" stroke="{COLOURS["mark"]}" stroke-width="6"/>'
        outline = f'<polygon points="{points}" fill="{COLOURS["cam"]}" stroke="{COLOURS["edge"]}" stroke-width="5"/>'
        axis = f'<circle r="{0.04 * self.largest:.1f}" fill="{COLOURS["edge"]}"/>'
        return f'<g class="moves cam">{outline}{mark}{axis}</g>'

    def carriage(self) -> str:
        """Followers, their frame, and the cart with its rollers."""
        bar = f'stroke="{COLOURS["cart"]}" stroke-width="10" fill="none"'
        ends = "".join(self._follower(x, bar) for x in (self.far, self.near))
        frame = f'<path d="M{self.far:.1f},0V{self.rail:.1f}H{self.near:.1f}V0H{self.axles.max():.1f}" {bar}/>'
        return f'<g class="moves carriage">{frame}{ends}{"".join(self._roller(x) for x in self.axles)}</g>'

    def _follower(self, x, bar):
        if isinstance(self.cam.follower, FlatFace):
            reach = MM * self.cam.largest_contact_offset
            return f'<path d="M{x:.1f},{-reach:.1f}V{reach:.1f}" {bar}/>'
        radius = POINT_RADIUS if isinstance(self.cam.follower, Pointed) else MM * self.cam.follower.radius
        return f'<circle cx="{x:.1f}" cy="0" r="{radius:.1f}" {self._disc_style()}/>'

    def _roller(self, x):
        spoke = f'<line x1="0" y1="0" x2="{self.radius:.1f}" y2="0" stroke="{COLOURS["cart"]}" stroke-width="5"/>'
        disc = f'<circle r="{self.radius:.1f}" {self._disc_style()}/>'
        return f'<g transform="translate({x:.1f} 0)"><g class="moves roller">{disc}{spoke}</g></g>'

    @staticmethod
    def _disc_style() -> str:
        return f'fill="{COLOURS["roller"]}" stroke="{COLOURS["cart"]}" stroke-width="5"'
