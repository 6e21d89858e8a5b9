"""The HTML page of a study, `report.html`: the answer, its uncertainty, and all results in sections.

The page is one file without external resources. Results are computed by the stages of the study; this module selects
and formats them.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

from compact.analysis.stages.balance_checks import BalanceCheck
from compact.analysis.study import Study
from compact.files import atomic_file
from compact.report.page import machine, motor, sizing
from compact.report.page.answer import answer, question
from compact.report.page.blocks import Mark, Paragraph, Section, Table, render_page
from compact.report.page.contact import contact_section, mix_section
from compact.report.tables import format_number

FILES_REMARK = "The tables and `summary.json` in the same directory hold every number with twelve digits."


def write_page(path: Path, study: Study, pictures: Mapping[str, bytes], versions: Mapping[str, str]) -> Path:
    """Write the page of a study."""
    sections = [
        machine.ranking_section(study, pictures),
        contact_section(study, pictures),
        machine.laws_section(study, pictures),
        machine.forces_section(study, pictures),
        *([] if study.over_durations is None else [sizing.duration_section(study.over_durations, pictures)]),
        motor.motor_section(study, pictures),
        sizing.work_section(study),
        *([] if study.first_cam is None else [machine.cams_section(study, pictures, study.first_cam)]),
        machine.sensitivity_section(study.sensitivities),
        machine.scene_section(study.scene),
        mix_section(study),
        _checks_section(study.checks),
        _versions_section(study, versions),
    ]
    title = study.scene.title or "untitled scene"
    content = render_page(title, sections=sections, answer=answer(study, study.checks, pictures), **question(study))
    with atomic_file(path) as stream:
        stream.write(content)
    return path


def _checks_section(checks: Sequence[BalanceCheck]) -> Section:
    """Tabulate the built-in checks."""
    rows = [
        (
            check.name, format_number(check.residual, 2), format_number(check.limit, 2),
            Mark("good", "passes") if check.passed else Mark("bad", "fails"),
        )
        for check in checks
    ]  # fmt: skip
    failed = sum(not check.passed for check in checks)
    lead = f"{len(checks)} balances and counts; {failed or 'none'} of them fail{'s' if failed == 1 else ''}."
    table = Table("Checks", ("check", "residual", "limit", ""), rows, (1, 2))
    return Section("checks", "Built-in checks", lead, [table])


def _versions_section(study: Study, versions: Mapping[str, str]) -> Section:
    rows = [*versions.items(), ("scene", f"`{study.scene.hash}`")]
    rows += [(f"computed: {stage}", str(count)) for stage, count in study.counts.items()]
    table = Table("Versions, fingerprint of the scene, and number of computations of each stage", ("of", "value"), rows)
    lead = "Packages, scene and stages of this page."
    return Section("versions", "Versions and files", lead, [Paragraph(FILES_REMARK), table])
