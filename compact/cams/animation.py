"""Animation of a cam and its cart as one SVG with CSS, without script or network; static in print.

The cam turns evenly, clockwise, one turn a cycle; both followers are in one carriage with the cart, whose rollers turn
by travel/radius. Positions are those of the law at FRAMES instants, linear in between. Drawn in millimetres, y down,
true to scale; the cart is shown next to the cam.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from compact.cams.followers import FlatFace, Pointed
from compact.cams.profile import Cam

MM = 1e3  # [mm/m]
FRAMES = 72  # [-], instants of a turn: every five degrees
PROFILE_POINTS = 361  # [-], of the profile as drawn
POINT_RADIUS = 8.0  # [mm], of the circle that shows a pointed follower
COLOURS = {"cam": "#d7e3f0", "edge": "#1f3a5f", "mark": "#5a6b7b", "cart": "#7a4a00", "roller": "#f0c987"}
MIX_COLOUR = "#c9c2b4"
DISC = f'fill="{COLOURS["roller"]}" stroke="{COLOURS["cart"]}" stroke-width="5"'  # of followers and rollers


def animated_svg(cam: Cam, roller_radius: float, roller_positions: Sequence[float], label: str) -> str:
    """Return the animation of a cam and its cart, lengths in m, as SVG text with an escaped label for readers."""
    angle = np.linspace(0, 2 * np.pi, FRAMES + 1)
    travel = MM * cam.cycle.derivative(angle * cam.cycle.period / (2 * np.pi), 0)
    radius, positions = MM * roller_radius, MM * np.asarray(roller_positions)
    style = "".join(
        [
            f".moves{{animation:{cam.cycle.period:g}s linear infinite}}",
            ".cam{animation-name:turn}.carriage{animation-name:travel}.roller{animation-name:roll}",
            "@keyframes turn{to{transform:rotate(360deg)}}",
            _keyframes("travel", travel, "translateX({:.3f}px)"),
            _keyframes("roll", np.degrees(travel / radius), "rotate({:.3f}deg)"),
            "@media print,(prefers-reduced-motion:reduce){.moves{animation:none}}",
        ]
    )
    x, y = MM * cam.profile(np.linspace(0, 2 * np.pi, PROFILE_POINTS))
    largest, stroke = np.hypot(x, y).max(), MM * cam.cycle.forward.stroke
    near, far, rail = MM * float(cam.radius(0.0)), -MM * float(cam.radius(np.pi)), -1.1 * largest
    axles = near + largest + stroke + positions.max() - positions.min() + positions - positions.mean()
    left, right = axles.min() - radius, axles.max() + radius + stroke  # of the mix under the rollers
    box = (far - 0.1 * largest, 1.05 * rail, right - far + 0.2 * largest, 2.15 * largest)
    size = f'width="{right - left:.1f}" height="{0.3 * largest:.1f}"'
    points = " ".join(f"{each:.2f},{-across:.2f}" for each, across in zip(x, y, strict=True))
    bar = f'stroke="{COLOURS["cart"]}" stroke-width="10" fill="none"'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{" ".join(f"{each:.1f}" for each in box)}" role="img" '
        f'aria-label="{label}"><style>{style}</style>'
        f'<rect x="{left:.1f}" y="{radius:.1f}" {size} fill="{MIX_COLOUR}"/>'
        '<g class="moves cam">'
        f'<polygon points="{points}" fill="{COLOURS["cam"]}" stroke="{COLOURS["edge"]}" stroke-width="5"/>'
        f'<path d="M0,0H{0.8 * np.hypot(x[0], y[0]):.1f}" stroke="{COLOURS["mark"]}" stroke-width="6"/>'
        f'<circle r="{0.04 * largest:.1f}" fill="{COLOURS["edge"]}"/></g>'
        '<g class="moves carriage">'
        f'<path d="M{far:.1f},0V{rail:.1f}H{near:.1f}V0H{axles.max():.1f}" {bar}/>'
        f"{_follower(cam, far, bar)}{_follower(cam, near, bar)}{''.join(_roller(x, radius) for x in axles)}</g></svg>\n"
    )


def _keyframes(name: str, values: Iterable[float], transform: str) -> str:
    """Keyframes of a CSS animation, evenly over its time."""
    stops = (f"{100 * i / FRAMES:.4g}%{{transform:{transform.format(value)}}}" for i, value in enumerate(values))
    return f"@keyframes {name}{{{''.join(stops)}}}"


def _follower(cam: Cam, x: float, bar: str) -> str:
    if isinstance(cam.follower, FlatFace):
        reach = MM * cam.largest_contact_offset
        return f'<path d="M{x:.1f},{-reach:.1f}V{reach:.1f}" {bar}/>'
    radius = POINT_RADIUS if isinstance(cam.follower, Pointed) else MM * cam.follower.radius
    return f'<circle cx="{x:.1f}" cy="0" r="{radius:.1f}" {DISC}/>'


def _roller(x: float, radius: float) -> str:
    spoke = f'<line x1="0" y1="0" x2="{radius:.1f}" y2="0" stroke="{COLOURS["cart"]}" stroke-width="5"/>'
    disc = f'<circle r="{radius:.1f}" {DISC}/>'
    return f'<g transform="translate({x:.1f} 0)"><g class="moves roller">{disc}{spoke}</g></g>'
