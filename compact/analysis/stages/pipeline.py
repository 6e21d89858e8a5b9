"""Stages of the computation of one scene: contacts, resistance, laws, drives; each stage uses those before it only."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from compact.analysis.contact_cases import scene_mix
from compact.analysis.stages.contacts import ContactStage, Count, Progress, no_count
from compact.analysis.stages.drives import DriveStage
from compact.analysis.stages.laws import LawStage, PrescribedLaws
from compact.analysis.stages.resistance import ResistanceStage
from compact.material.mix import Mix
from compact.motion.profile import Cycle
from compact.scene.loader import Scene

Cycles = Mapping[str, Cycle]


@dataclass(frozen=True)
class Stages:
    """Stages of one scene; the attributes of each are computed when first used."""

    prescribed: PrescribedLaws
    contacts: ContactStage
    resistance: ResistanceStage
    laws: LawStage
    drive: DriveStage


def build_stages(
    scene: Scene,
    mix: Mix | None = None,
    count: Count = no_count,
    directory: Path | None = None,
    progress: Progress | None = None,
    known_laws: tuple[Cycles, Cycles] | None = None,
) -> Stages:
    """Build the stages of a scene; nothing is computed yet.

    Parameters
    ----------
    mix : Mix, optional
        That of the scene by default.
    count : callable
        Called with the name of each stage that begins.
    directory : Path, optional
        Results of an earlier run.
    progress : callable, optional
        Called with lines of text by engines with continuation.
    known_laws : tuple of mapping, optional
        Prescribed laws and all laws, if they are known.
    """
    prescribed = PrescribedLaws(scene, count)
    if known_laws:
        prescribed.cycles = dict(known_laws[0])
    contacts = ContactStage(scene, mix or scene_mix(scene), count, directory, progress)
    resistance = ResistanceStage(contacts, prescribed.largest_speed)
    laws = LawStage(prescribed, resistance, known_laws and known_laws[1])
    return Stages(prescribed, contacts, resistance, laws, DriveStage(contacts, resistance, laws))
