"""What the page says first: what was asked, which law, how much it takes, and how sure that is; in plain words."""

from html import escape

import numpy as np

from compact import quantities
from compact.analysis.engines import COMPACTING
from compact.machine.ranking import CRITERIA
from compact.report.contact_tables import guide_sentence, return_sentence
from compact.report.page import listed, paragraph, percent, quantity, sentence, strong
from compact.report.ranking_tables import agreements, places

WORDS = {name: quantity.term for name, quantity in quantities.CRITERIA.items()}
TIED = "closer than the 1 % to which a machine is built"
SAID = 2  # criteria in the answer, those that the scene names first
ENGINES = {
    "formula": "the engineering formulas 1.1–1.10",
    "column": "columns of a layer that stays pressed",
    "spectral": "an elastic or relaxing layer on its base, solved in Fourier space",
    "fem": "an elastic or relaxing layer by finite elements",
    "compaction": "a layer that stays pressed, by finite elements",
}


def asked(study):
    """The question, in a paragraph."""
    scene, laws = study.scene, len(study.cycles)
    machine, motion = scene.machine, scene.motion
    rollers = f"{machine.rollers} roller{'s' if machine.rollers > 1 else ''}"
    lifts = f", in lifts of {quantity(scene.lift_thickness, 'm')}," if scene.layer.lift_thickness else ""
    stands = f" and stands {quantity(motion.dwell, 's')} at each end" if motion.dwell else ""
    return paragraph(
        f"A cart of {quantity(machine.mass, 'kg')} with {rollers} of radius {quantity(machine.roller_radius, 'm')} and "
        f"length {quantity(machine.roller_length, 'm')} goes {quantity(motion.stroke, 'm')} there and back, "
        f"{quantity(motion.duration, 's')} each way{stands}, and presses a product "
        f"{quantity(scene.product.height, 'm')} high{lifts} to the density ratio {scene.mix.density_ratio:g} from a "
        f"mix of {100 * scene.mix.moisture:g} % moisture. "
        + (
            f"Which of {laws} motion laws asks least"
            if laws > 1
            else f"What does the law {next(iter(study.cycles))} ask"
        )
        + f" of the drive ({escape(scene.drive.kind)})? The contact is that of {escape(ENGINES[_engine(study)])}."
    )


def answer(study, shifts, found):
    """The answer and how sure it is; `shifts` as of `sensitivity`, `found` as of `checks`."""
    orders = _first_few(study.places[study.scene.drive.kind])
    said = [_winner(by, order) for by, order in orders.items()] + _endless(orders) + _conflict(orders)
    rigid = _first_few(study.places.get("rigid", {}) if study.scene.drive.kind != "rigid" else {})
    said += [f"With a rigid drive: {_winner(by, order)}" for by, order in rigid.items()]
    said += [f"The law {strong(name)} is not made: {escape(why)}." for name, why in study.laws_not_made.items()]
    said.append(_met(study))
    if not study.mix.density_achievable:
        said.append(f"{strong('Not reachable by rolling:')} {escape(study.mix.density_achievable.reason)}.")
    sure = [
        _known_by_engine(study),
        *_first_is_sure(orders),
        _known_by_mix(study),
        *_by_engines_beside(study),
        _order_holds(shifts),
    ]
    failed = [check.name for check in found if not check.passed]
    sure.append(
        f"{strong('Built-in checks that fail:')} {escape(', '.join(failed))}."
        if failed
        else f"All {len(found)} built-in checks hold: balances of energy and forces, and the published numbers."
    )
    sure += [f"{escape(sentence)}." for told in study.scene.replacements.values() for sentence in told]
    sure += [escape(sentence) for sentence in study.scene.advice]
    return (
        f'<section class="answer" aria-label="answer">{"".join(map(paragraph, said))}</section>'
        f'<section class="sure" aria-label="how sure"><h3>How sure is this?</h3>{listed(sure)}</section>'
    )


def _first_few(orders):
    """The orders by the criteria that the scene names first; the others stand in the tables."""
    return dict(list(orders.items())[:SAID])


def _engine(study):
    return study.scene.accuracy.engine


def _winner(by, places):
    """Who is first by a criterion, by how much, and what the last asks."""
    first = _firsts(places)
    if not first:
        return f"No law has a finite {WORDS[by]}: {escape(places[0].reason)}."
    if len(places) == 1:
        return f"Its {WORDS[by]} is {strong(quantity(first[0].value, CRITERIA[by].unit, 3))}."
    names = " and ".join(strong(place.law) for place in first)
    value = strong(quantity(first[0].value, CRITERIA[by].unit, 3))
    finite = [place for place in places if not place.reason]
    asks = f"The law {names} asks" if len(first) == 1 else f"The laws {names} ask"
    said = f"{asks} for the least {WORDS[by]}: {value}."
    if finite[-1].rank > 1:
        following, last = finite[len(first)], finite[-1]
        said += f" The next, {escape(following.law)}, "
        said += f"ties with it, {TIED}" if first[0].tie else f"takes {_taken(following.value, first[0].value, by)}"
        if last is not following:
            said += f"; the last, {escape(last.law)}, takes {_taken(last.value, first[0].value, by)}"
        said += "."
    return said


def _firsts(places):
    """The places that are first; none where all are infinite."""
    return [place for place in places if place.rank == 1 and not place.reason]


def _taken(value, least, by):
    """A value in words: its share above the least, or itself where that share means nothing."""
    criterion = CRITERIA[by]
    if criterion.floor or not least > 0:
        return quantity(value, criterion.unit, 3)
    return f"{percent(value / least - 1)} more"


def _endless(orders):
    """The laws that have no finite peak, each reason once for all criteria."""
    reasons = {}
    for place in (place for order in orders.values() for place in order if place.reason):
        reasons.setdefault(place.reason, {})[place.law] = None
    return [f"No machine can follow {escape(' and '.join(names))}: {escape(why)}." for why, names in reasons.items()]


def _conflict(orders):
    """What the first by one criterion takes by another, where they differ."""
    said = []
    firsts = {by: _firsts(order) for by, order in orders.items()}
    for by, first in firsts.items():
        for other, order in orders.items():
            best = firsts[other]
            if by == other or not first or not best or best[0].law in [p.law for p in first]:
                continue
            value = next(p.value for p in order if p.law == first[0].law)
            if np.isfinite(value):
                law, taken = escape(first[0].law), _taken(value, best[0].value, other)
                said.append(f"The law {law} pays for its {WORDS[by]} with {taken} {WORDS[other]}.")
    return [" ".join(dict.fromkeys(said))] if said else []


def _met(study):
    """What the machine meets at its mean speed."""
    mean = study.scene.mean_speed
    force = float(np.ravel(study.resistance(np.array([mean]), np.zeros(1)))[0])
    return (
        f"At its mean speed of {quantity(mean, 'm/s', 3)} the cart meets {strong(quantity(force, 'N', 3))} of "
        "resistance of the mix; "
        f"each roller is held down by {strong(quantity(study.roller_load, 'N', 3))}. "
        f"{sentence(guide_sentence(study))} {sentence(return_sentence(study))}"
    )


def _known_by_engine(study):
    engine = _engine(study)
    if not study.layered:
        return (
            "The formulas cannot tell their own error. They are reconstructed from a damaged source, with a confidence "
            "of 60–95 % each, and know no speed and no depth of the layer."
        )
    met = study.resistance_map
    own = "does not know its own error"
    if met.engine_error is not None:
        own = f"puts its own error at {percent(met.engine_error)}"
    own += ", of its arithmetic alone: columns know no second dimension," if engine == "column" else ""
    model = (
        "the mix stays pressed, as it does"
        if engine in COMPACTING
        else "the mix springs back, which leaves out most of the resistance of a mix that stays pressed"
    )
    return (
        f"The engine {escape(engine)} {own}, and between its {len(met.speeds)} speeds the resistance is read to "
        f"{percent(met.error)} of the largest. In it {model}."
    )


def _first_is_sure(orders):
    """Whether the error of the resistance leaves the first law first."""
    for by, order in orders.items():
        first = _firsts(order)
        if not first or len(first) == len(order):
            continue
        if first[0].tie:
            yield f"The first law by {WORDS[by]} is one of several that tie: they are {TIED}."
        if first[0].error is None or first[0].tie:
            continue
        moved = quantity(max(place.error for place in first), CRITERIA[by].unit, 2)
        told = "does not reach the next" if all(place.sure for place in first) else "may put another law first"
        yield f"The error of the resistance moves the least {WORDS[by]} by {moved}: it {told}."


def _known_by_mix(study):
    needed, force = study.mix.parameter("required_pressure"), study.numbers["roller_force"]
    low, high = quantity(needed.low, "Pa", 3), quantity(needed.high, "Pa", 3)
    said = (
        "The mix is known from a table, not measured: the pressure that it needs is "
        f"{quantity(needed.value, 'Pa', 3)}, but may be {low} to {high}"
    )
    if needed.flag == "given":
        return f"The pressure that the mix needs, {quantity(needed.value, 'Pa', 3)}, is yours."
    if force.low is None or force.high is None:
        return f"{said}."
    return (
        f"{said}; by formula that alone makes the force on a roller {quantity(force.low, 'N', 3)} to "
        f"{quantity(force.high, 'N', 3)}. Measure it, and give it under <code>[mix.overrides]</code>."
    )


def _by_engines_beside(study):
    """Whether the engines beside agree on who is first behind the scene's drive; the orders stand in the tables."""
    own, said = study.scene.drive.kind, {name: [] for name in study.beside}
    for _, kind, engine, also, by, found, first, other in agreements(study) if study.beside else []:
        if not kind == also == own or by not in _first_few(study.places[own]):
            continue
        theirs = places(study)[engine][own][by][0]
        who = "first as well" if first == other else "first"
        said[engine].append(
            f"{escape(theirs.law)} is {who} by {WORDS[by]} ({quantity(theirs.value, CRITERIA[by].unit, 3)}; "
            f"{found.sure} of {found.pairs} pairs of laws turn round beyond the errors)"
        )
    return [f"By {escape(engine)} {', '.join(sentences)}." for engine, sentences in said.items()]


def means(shifts):
    """By what the ends of inputs were computed, in words."""
    found = dict.fromkeys("formula" if shift.by == "formula" else f"the engine {shift.by}" for shift in shifts)
    return f"By {' or '.join(found) or 'formula'}"


def _order_holds(shifts):
    """Which inputs change who is first."""
    changed = {}
    for shift in shifts:
        for by, law in shift.base.law.items():
            ends = [end for end in (shift.low, shift.high) if end is not None and law not in end.ties[by]]
            if ends:
                changed.setdefault(shift.name, set()).update(f"{end.law[by]} by {WORDS[by]}" for end in ends)
    beyond = sum((shift.low is None) + (shift.high is None) for shift in shifts)
    if not changed:
        return (
            f"{means(shifts)} and with a rigid drive, moving any one of {len(shifts)} inputs to either end of its "
            "spread (a tenth where it has none) leaves the first law first"
            + (f"; {beyond} of the ends are beyond reach." if beyond else ".")
        )
    who = "; ".join(f"{name}: {', '.join(sorted(laws))}" for name, laws in changed.items())
    return (
        f"{means(shifts)} and with a rigid drive the first law is another where one input is at an end: {escape(who)}."
    )
