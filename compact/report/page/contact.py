"""Sections of the page on the contact: formulas and exact theory, the engine over speed, the fields, and the mix."""

from collections.abc import Iterator, Mapping, Sequence

from compact import quantities
from compact.analysis.engineering_summary import coverage
from compact.analysis.study import Study
from compact.report.page.blocks import Block, Cell, Mark, Paragraph, Section, Table, as_sentence, embed_figures
from compact.report.tables import format_number, format_percent, format_quantity
from compact.report.text import held_sentence

CONTACT_HEADER = (
    "speed", "load", "error", "resistance", "error", "coefficient", "trailing edge", "leading edge", "peak pressure",
    "indentation",
)  # fmt: skip
FIGURES = {  # name -> (description, caption)
    "pressure": (
        "Pressure along the contact of one roller, with Galin's exact pressure on a half-plane at the same peak",
        "Dots and crosses: engine of the scene, or formula. Line: exact theory of a half-plane at the required "
        "pressure of the mix. The roller moves to the right.",
    ),
    "section": (
        "Section through mould and roller with the density in colour, and load, resistance and density along it",
        "Forming process at the mean speed. Every place under the roller has had one stroke more than its neighbour at "
        "the empty mould; the forces of the drive are the sums over the roller.",
    ),
    "contact": (
        "Load and rolling-resistance coefficient of one roller at each speed, with bars for the error estimate",
        "Load and rolling-resistance coefficient of one roller; bars are the error estimates of the engine.",
    ),
    "resistance": (
        "Resistance of one cart over its speed, at steady speed and with acceleration",
        "F(v, a), the resistance against which the drive moves the cart. Dots are computed, lines are interpolated. "
        "Colours: F(v) + a M(v) at accelerations up to the usual ones of the laws, where the engine computes the added "
        "mass M; dotted beyond first order in the acceleration.",
    ),
    "resistances": (
        "Resistance of one cart over its speed, by each engine",
        "At steady speed, by the engine of the scene and those of the comparison.",
    ),
    "fields": (
        "Fields in the layer under the roller at each speed, drawn to scale on the deformed elements",
        "Fields in the layer down to its base: element means, one colour scale of each field for all speeds. The files "
        "open in ParaView.",
    ),
}
NO_SPEED = """The engine is the formulas: the resistance is dry friction, the same at every speed and acceleration, \
F(v, a) = F sign(v)."""
KNOWN_FLAGS = ("measured", "given", "derived")  # of parameters of the mix; all others are assumed


def contact_section(study: Study, pictures: Mapping[str, bytes]) -> Section:
    """Describe the contact of one roller and the resistance of a cart."""
    blocks: list[Block] = list(_formula_blocks(study))
    if study.stages.contacts.held:
        blocks.append(Paragraph(as_sentence(held_sentence(study))))
    blocks += _engine_tables(study) if study.stages.contacts.engine.layered else [Paragraph(NO_SPEED)]
    blocks += embed_figures(pictures, FIGURES)
    lead = f"{format_quantity(study.stages.contacts.roller_load, 'N', 3)} on a roller"
    formula = format_quantity(study.stages.contacts.numbers["roller_force"].value, "N", 3)
    lead += f"; {formula} by formula." if study.stages.contacts.engine.layered else ", by formula."
    return Section("contact", "Contact and resistance", lead, blocks)


def mix_section(study: Study) -> Section:
    """List the parameters of the mix with spread and origin."""
    rows: list[Sequence[Cell]] = []
    for p in study.mix.parameters:
        numbers = (format_quantity(number, p.unit) for number in (p.value, p.low, p.high))
        flag = Mark("known" if p.flag in KNOWN_FLAGS else "assumed", p.flag)
        rows.append((p.name.replace("_", " "), *numbers, flag, p.origin))
    header = ("parameter", "value", "low", "high", "flag", "origin")
    mix = study.scene.mix
    lead = f"{100 * mix.moisture:g} % moisture content, density ratio {mix.density_ratio:g}; origin of each parameter."
    return Section("mix", "Mix", lead, [Table("Parameters of the mix", header, rows, (1, 2, 3))])


def _formula_blocks(study: Study) -> Iterator[Block]:
    """Tabulate the formulas and the exact contact; state whether the rollers cover the product."""
    rows = []
    for name, n in study.stages.contacts.numbers.items():
        low, high = (format_quantity(end, n.unit) if end else "" for end in (n.low, n.high))
        rows.append((name.replace("_", " "), format_quantity(n.value, n.unit), low, high, n.known_by))
    caption = "By formulas 1.1–1.10 and exact theory; low and high over the spread of the mix"
    yield Table(caption, ("quantity", "value", "low", "high", "known by"), rows, (1, 2, 3))
    if short := coverage(study.scene, study.stages.contacts.engineering):
        yield Paragraph(f"{short}.")


def _engine_tables(study: Study) -> Iterator[Table]:
    """Tabulate the contact over speed; of a compacting layer also each pass."""
    engine = study.scene.accuracy.engine
    rows = [
        (
            format_quantity(contact.speed, "m/s"), format_quantity(contact.load, "N/m"),
            _error(contact.load_error), format_quantity(contact.resistance, "N/m"), _error(contact.resistance_error),
            format_number(contact.coefficient), format_quantity(-contact.trailing, "m"),
            format_quantity(contact.leading, "m"), format_quantity(contact.peak_pressure, "Pa"),
            format_quantity(contact.indentation, "m"),
        )
        for contact in study.contacts
    ]  # fmt: skip
    caption = f"One roller by the engine {engine}, per metre of its length, with its error estimates"
    yield Table(caption, CONTACT_HEADER, rows, range(len(CONTACT_HEADER)))
    if study.stages.contacts.engine.compacting:
        header = ("speed", "pass", *(quantity.term for quantity in quantities.PASS.values()))
        passes = [
            (
                format_quantity(contact.speed, "m/s"), str(number),
                *(format_quantity(getattr(each, name), quantity.unit) for name, quantity in quantities.PASS.items()),
            )
            for contact in study.contacts
            for number, each in enumerate(contact.passes, start=1)
        ]  # fmt: skip
        yield Table("Forces and compaction of each pass", header, passes, range(len(header)))


def _error(error: float | None) -> str:
    return format_percent(float("nan") if error is None else error)
