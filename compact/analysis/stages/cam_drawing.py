"""Drawing and animation of the cam of the first law, as SVG text for the page of a study.

The cam is cut with the default tolerance and a cutter of any radius; `compact cam` writes the files for the workshop.
"""

from dataclasses import dataclass
from html import escape

from compact.analysis.stages.drives import Stages
from compact.cams.machining import cut
from compact.cams.workshop_drawing import animated_svg, describe, workshop_drawing

FOLLOWER = "roller"  # of the cam that is drawn


@dataclass(frozen=True)
class CamDrawing:
    """Cam of one law as SVG text; without drawing and animation where the cam cannot be cut.

    Parameters
    ----------
    description : str
        Description of the drawing in one sentence.
    drawing : str
        Workshop drawing as SVG text, true to scale.
    animation_description : str
        Description of the animation in one sentence.
    animation : str
        Cam and cart in motion as SVG text.
    reason : str
        Reason for which the cam cannot be cut; empty where it can.
    """

    law: str
    description: str = ""
    drawing: str = ""
    animation_description: str = ""
    animation: str = ""
    reason: str = ""


def first_cam_drawing(stages: Stages) -> CamDrawing:
    """Draw the cam of the first law, and animate it with the cart.

    Parameters
    ----------
    stages : Stages
        Stages of a scene with a table [cam].

    Returns
    -------
    CamDrawing
        Its reason says why a cam cannot be cut: undercut, corners, or a bore that is too large.
    """
    scene, law = stages.laws.scene, stages.drive.best_law
    try:
        outline = cut(stages.laws.cams[law, FOLLOWER])
        drawing = workshop_drawing(outline, scene.cam.bore if scene.cam else None)
    except ValueError as error:
        return CamDrawing(law, reason=str(error))
    description, machine = describe(outline), scene.machine
    words = f"The cam of {law} turns, and its followers move the cart through a cycle"
    animation = animated_svg(outline.cam, machine.roller_radius, machine.roller_positions, escape(words))
    return CamDrawing(law, description, drawing.svg(description), words, animation)
