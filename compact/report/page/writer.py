"""The HTML page of a study, `report.html`: the answer, its uncertainty, and all results in sections.

The page is one file without external resources. Results are computed by the stages of the study; this module selects
and formats them.
"""

from collections.abc import Mapping
from pathlib import Path

from compact.analysis.study import Study
from compact.files import atomic_file
from compact.report.page.answer import answer, question
from compact.report.page.blocks import Paragraph, Section, Table, render_page
from compact.report.page.contact import contact_section, mix_section
from compact.report.page.machine import (
    cams_section,
    checks_section,
    forces_section,
    laws_section,
    ranking_section,
    scene_section,
    sensitivity_section,
)

FILES_REMARK = "The tables and `summary.json` in the same directory hold every number with twelve digits."


def write_page(path: Path, study: Study, pictures: Mapping[str, bytes], versions: Mapping[str, str]) -> Path:
    """Write the page of a study.

    Parameters
    ----------
    versions : mapping of str to str
        Versions by package.
    """
    sections = [
        ranking_section(study, pictures),
        contact_section(study, pictures),
        laws_section(study, pictures),
        forces_section(study, pictures),
        *([] if study.first_cam is None else [cams_section(study, pictures, study.first_cam)]),
        sensitivity_section(study.sensitivities),
        scene_section(study.scene),
        mix_section(study),
        checks_section(study.checks),
        _versions_section(study, versions),
    ]
    title = study.scene.title or "untitled scene"
    content = render_page(title, sections=sections, answer=answer(study, study.checks), **question(study))
    with atomic_file(path) as stream:
        stream.write(content)
    return path


def _versions_section(study: Study, versions: Mapping[str, str]) -> Section:
    rows = [*versions.items(), ("scene", f"`{study.scene.hash}`")]
    rows += [(f"computed: {stage}", str(count)) for stage, count in study.counts.items()]
    table = Table("Versions, fingerprint of the scene, and number of computations of each stage", ("of", "value"), rows)
    lead = "Packages, scene and stages of this page."
    return Section("versions", "Versions and files", lead, [Paragraph(FILES_REMARK), table])
