"""The page `report.html` of a study: the answer in plain words, how sure it is, and behind it all that was computed.

One file that needs no network. What a scene does not want is not computed for it. Pictures come by the names of the
figures, each as what gives its bytes of PNG, which may still be drawn in another process.
"""

from html import escape

from compact.analysis import sensitivity
from compact.files import atomic_file
from compact.report import html_contact, html_machine
from compact.report.html_answer import answer, asked
from compact.report.page import Section, page, paragraph, table
from compact.verification.balance_checks import balance_checks


def write_page(path, study, pictures, versions):
    """Write the page of a study; `versions` of packages by name. Returns the path."""
    title = study.scene.title or "untitled scene"
    shifts = sensitivity.shifts(study)
    found = balance_checks(study)
    parts = [
        html_machine.ranking(study, pictures),
        html_contact.contact(study, pictures),
        html_machine.laws(study, pictures),
        html_machine.forces(study, pictures),
        html_machine.cams(study, pictures),
        html_machine.moves(shifts),
        html_machine.scene(study.scene),
        html_contact.mix(study),
        html_machine.built_in(found),
        _versions(study, versions),
    ]
    parts = [part for part in parts if part is not None]
    body = [
        f"<header><h1>{escape(title)}</h1>{asked(study)}</header>",
        answer(study, shifts, found),
        f'<nav aria-label="details">{" ".join(part.link() for part in parts)}</nav>',
        *(part.html() for part in parts),
    ]
    with atomic_file(path) as stream:
        stream.write(page(title, "\n".join(body)))
    return path


def _versions(study, versions):
    rows = [(escape(name), escape(version)) for name, version in versions.items()]
    rows += [("scene", f"<code>{study.scene.hash}</code>")]
    rows += [(f"computed: {escape(stage)}", str(count)) for stage, count in study.counts.items()]
    said = paragraph("The tables and <code>summary.json</code> beside this page hold every number with twelve digits.")
    body = said + table(("of", "is"), rows, "Versions, fingerprint of the scene, and how often each stage was computed")
    return Section("versions", "Versions and files", "What made this page.", body)
