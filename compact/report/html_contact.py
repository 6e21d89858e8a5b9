"""What the page says of the contact: formulas and exact theory, the engine over speed, what is inside, and the mix."""

from html import escape

from compact import quantities
from compact.analysis.engineering_summary import coverage
from compact.analysis.engines import COMPACTING
from compact.report.contact_tables import held_sentence
from compact.report.page import Section, mark, number, paragraph, percent, picture, quantity, sentence, table

CONTACT = ("speed", "load", "error", "resistance", "error", "coefficient", "behind", "ahead", "peak pressure", "depth")
CAPTIONS = {
    "pressure": (
        "Pressure along the contact of one roller, with Galin's exact pressure on a half-plane at the same peak",
        "Dots and crosses: the engine of the scene, or the formula. Line: exact theory of a half-plane at the pressure "
        "that the mix needs. The roller goes to the right.",
    ),
    "contact": (
        "Load and resistance over load of one roller at each speed, with bars for the engine's own error",
        "Load and resistance over load of one roller; bars are the engine's own error.",
    ),
    "resistance": (
        "Resistance of the mix to one cart over its speed, at steady speed and with acceleration",
        "F(v, a): what the drive meets. Dots are computed, lines are read between them. Colours: at accelerations up "
        "to what the laws usually reach, F(v) + a M(v), where the engine tells M; dotted where the motion is too "
        "unsteady for that.",
    ),
    "resistances": (
        "Resistance of the mix to one cart over its speed, by each engine",
        "At steady speed, by the engine of the scene and by those beside it.",
    ),
    "fields": (
        "Fields in the layer under the roller at each speed, drawn to scale on the deformed elements",
        "What happens inside the layer down to its base; element means, one colour scale of each field for all "
        "speeds. The files open in ParaView.",
    ),
}


def contact(study, pictures):
    """The contact of one roller and what the cart meets."""
    shown = [picture(pictures[name](), *_captioned(name)) for name in CAPTIONS if name in pictures]
    kept = [paragraph(sentence(held_sentence(study)))] if study.held else []
    parts = [_numbers(study), *kept, *(_engine_tables(study) if study.layered else [_no_speed()]), *shown]
    lead = f"{quantity(study.roller_load, 'N', 3)} on a roller"
    lead += (
        f"; {quantity(study.numbers['roller_force'].value, 'N', 3)} by formula." if study.layered else ", by formula."
    )
    return Section("contact", "Contact and resistance", lead, "".join(parts))


def _captioned(name):
    words, caption = CAPTIONS[name]
    return words, escape(caption)


def _no_speed():
    return paragraph(
        "The engine is the formulas: the resistance is dry, the same at every speed and acceleration, "
        "F(v, a) = F sign(v)."
    )


def _numbers(study):
    rows = [
        (
            escape(name.replace("_", " ")), quantity(n.value, n.unit), quantity(n.low, n.unit) if n.low else "",
            quantity(n.high, n.unit) if n.high else "", escape(n.known_by),
        )
        for name, n in study.numbers.items()
    ]  # fmt: skip
    header = ("quantity", "value", "low", "high", "known by")
    caption = "By formula 1.1–1.10 and exact theory; low and high over the mix's spread"
    short = coverage(study.scene, study.engineering)
    return table(header, rows, caption, (1, 2, 3)) + (paragraph(escape(f"{short}.")) if short else "")


def _engine_tables(study):
    """The engine over speed, and what every pass leaves where it leaves a mark."""
    rows = []
    for contact in study.contacts:
        errors = (contact.load_error, contact.resistance_error)
        load_error, resistance_error = (float("nan") if error is None else error for error in errors)
        rows.append((
            quantity(contact.speed, "m/s"), quantity(contact.load, "N/m"), percent(load_error),
            quantity(contact.resistance, "N/m"), percent(resistance_error), number(contact.coefficient),
            quantity(-contact.trailing, "m"), quantity(contact.leading, "m"), quantity(contact.peak_pressure, "Pa"),
            quantity(contact.indentation, "m"),
        ))  # fmt: skip
    engine = study.scene.accuracy.engine
    numeric = range(len(CONTACT))
    yield table(
        CONTACT, rows, f"One roller by the engine {engine}, per metre of its length, with its own errors", numeric
    )
    if engine in COMPACTING:
        passes = [
            (
                quantity(contact.speed, "m/s"), str(count),
                *(quantity(getattr(passed, name), each.unit) for name, each in quantities.PASS.items()),
            )
            for contact in study.contacts
            for count, passed in enumerate(contact.passes, start=1)
        ]  # fmt: skip
        header = ("speed", "pass", *(name.replace("_", " ") for name in quantities.PASS))
        yield table(header, passes, "What each pass takes and leaves", range(len(header)))


FLAGS = {"measured": "known", "given": "known", "derived": "known"}


def mix(study):
    """The mix with spread and origin of each parameter."""
    rows = [
        (
            escape(p.name.replace("_", " ")), quantity(p.value, p.unit), quantity(p.low, p.unit),
            quantity(p.high, p.unit), mark(FLAGS.get(p.flag, "assumed"), p.flag), escape(p.origin),
        )
        for p in study.mix.parameters
    ]  # fmt: skip
    scene = study.scene.mix
    body = table(("parameter", "value", "low", "high", "flag", "origin"), rows, "Parameters of the mix", (1, 2, 3))
    lead = (
        f"{100 * scene.moisture:g} % moisture, density ratio {scene.density_ratio:g}; where each parameter comes from."
    )
    return Section("mix", "Mix", lead, body)
