"""What the page says of the machine: ranking, laws, forces, cams, what moves the answer, the scene, and the checks."""

from html import escape

import numpy as np

from compact.analysis.ranking_uncertainty import ties
from compact.analysis.sensitivity import PRIOR
from compact.analysis.study import FOLLOWERS, YIELDING
from compact.machine.ranking import CRITERIA
from compact.report.html_answer import WORDS, means
from compact.report.page import (
    ROUNDING,
    Section,
    column,
    mark,
    number,
    paragraph,
    percent,
    picture,
    quantity,
    table,
    table_of,
)
from compact.report.ranking_tables import agreements, beside

ASSUMED = ("assumed", "guess", "changed by the caller")  # words that begin a clause of a remark
KNOWN = ("published", "measured", "calibrated")


def ranking(study, pictures):
    """The laws by each criterion and drive, by the scene's engine and by those beside, and how far these agree."""
    shown = [picture(pictures[name](), *said) for name, said in ORDERS.items() if name in pictures]
    tables = [
        _ranked(kind, by, order, beside(study, kind, by))
        for kind, orders in study.places.items()
        for by, order in orders.items()
    ]
    lead = f"{len(study.cycles)} laws by {' and '.join(WORDS[by] for by in study.rankings)}."
    return Section("ranking", "Ranking", lead, "".join([*shown, _agreed(study), *tables]))


ORDERS = {
    "ranking": (
        "Bars of the ranked laws, a panel for each criterion, best on top",
        "Bars: the scene's engine and drive, and what the error of the resistance moves them. Marks: other engines, "
        "their heights within a row only keep them apart.",
    ),
    "engines": (
        "What each law asks above the least, by every engine and drive",
        "Above the least of each engine, with its error. Laws that are best by any engine, each in a row of its own; "
        "the heights within a row only keep the marks apart.",
    ),
}


def _ranked(kind, by, places, beside):
    """A table of places; with those by other engines, their ranks in brackets."""
    unit = CRITERIA[by].unit
    columns = {
        "rank": [str(place.rank) for place in places],
        "law": [escape(place.law) for place in places],
        WORDS[by]: column([place.value for place in places], unit),
        "to the next": ["tie" if place.tie else percent(place.margin) for place in places],
    }
    if places[0].error is not None:
        columns["error"] = column([place.error for place in places], unit, 2)
        ranks = [place.rank for place in places]
        shared = [tied or ranks.count(rank) > 1 for tied, rank in zip(ties(places, by), ranks, strict=True)]
        columns["place"] = [_sureness(*each) for each in zip(places, shared, strict=True)]
    for engine, order in beside.items():
        others = [order.get(place.law) for place in places]
        values = column([other and other.value for other in others], unit)
        columns[f"by {engine}"] = [
            f"{value} ({other.rank})" if other else value for value, other in zip(values, others, strict=True)
        ]
    columns["note"] = [escape(place.reason) for place in places]
    return table_of(columns, f"Laws by {WORDS[by]}, {kind} drive, least first", ("law", "place", "note"))


def _sureness(place, tied):
    """A word for how sure a place is, which is a tie where another law shares it or is within the build tolerance."""
    if place.reason:
        return "–"
    return "tie" if tied else "sure" if place.sure else "in doubt"


def _agreed(study):
    """How far the orders by engine and drive agree."""
    rows = [
        (
            escape(WORDS[by]), f"{escape(engine)}, {kind}", f"{escape(other)}, {also}", escape(one), escape(first),
            f"{found.swaps} of {found.pairs}", str(found.sure), number(found.tau, 3),
        )
        for engine, kind, other, also, by, found, one, first in agreements(study)
    ]  # fmt: skip
    header = ("by", "order of", "beside", "first", "its first", "pairs swapped", "beyond the errors", "Kendall's tau")
    return table(header, rows, "Whether the orders agree", (5, 6, 7)) if rows else ""


def laws(study, pictures):
    """The laws themselves: kinematics, peaks, continuity."""
    cycles, order = study.cycles.values(), ("velocity", "acceleration", "jerk", "snap")
    turn = "dwell" if study.scene.motion.dwell > 0 else "reversal"
    peaks = [cycle.there.peaks() for cycle in cycles]
    jumps = [sorted({join.quantity for join in cycle.joins()}, key=order.index) for cycle in cycles]
    columns = {
        "law": [escape(name) for name in study.cycles],
        "peak velocity": column([peak.velocity for peak in peaks], "m/s"),
        "peak acceleration": column([peak.acceleration for peak in peaks], "m/s2"),
        "peak jerk": column([peak.jerk for peak in peaks], "m/s^3"),
        "continuity": [f"C{cycle.there.smoothness(turn)}" for cycle in cycles],
        "what jumps": [", ".join(names) or "nothing" for names in jumps],
    }
    words = "Velocity, acceleration and jerk of every law over the way there, a row for each family of laws"
    said = "Every law over the way there. The way back mirrors it, and that of a crank retraces it."
    if study.scene.drive.kind in YIELDING:
        said += " The drive yields: the motion that the cart makes of a law is in the files cycles/LAW.csv."
    shown = picture(pictures["kinematics"](), words, said)
    caption = "Exact peaks inside the pieces, and what jumps at their joins"
    body = shown + table_of(columns, caption, ("law", "continuity", "what jumps"))
    return Section("laws", "Motion laws", "Kinematics, exact peaks, what jumps.", body)


PICTURES = {
    "drive": (
        "Drive force and power of every law over a cycle",
        "What each law asks of the drive, there and back. A peak beyond the scale is named in its panel.",
    ),
    "reactions": ("Reactions of the guide wheels over a cycle", "Below zero a wheel runs on the other rail."),
    "crank": ("Torque and power of the shaft over a turn for one to four carts", "Dashed: the means over a turn."),
}


def forces(study, pictures):
    """Forces, power and energy of every law."""
    runs = study.runs.values()
    columns = {"law": [escape(name) for name in study.runs]}
    for of in RUN:
        columns[of.replace("_", " ")] = column([getattr(run, of) for run in runs], CRITERIA[of].unit)
    columns["unevenness of speed"] = [percent(run.nonuniformity) for run in runs]
    if study.scene.drive.kind == "elastic":
        columns["ringing"] = column([run.ringing for run in runs], "1")
    shown = "".join(picture(pictures[name](), *said) for name, said in PICTURES.items() if name in pictures)
    body = shown + table_of(columns, f"One cart, {study.scene.drive.kind} drive, over a cycle")
    return Section("forces", "Forces and power", "Of one cart over a cycle; guide wheels; shaft.", body)


RUN = (
    "peak_force", "rms_force", "peak_power", "rms_power", "mean_power", "energy", "drawn_energy", "dynamic_factor",
)  # fmt: skip


def cams(study, pictures):
    """Cams of all laws, and the first law's to cut, drawn and in motion; nothing where no cams are wanted."""
    if "cams" not in study.scene.output.items:
        return None
    rows = [_cam_row(law, {follower: study.cams[law, follower] for follower in FOLLOWERS}) for law in study.cycles]
    kinds = [f"least breadth, {follower}" for follower in FOLLOWERS]
    header = ("law", *kinds, "least radius, roller", "pressure angle, roller", "half-width, flat")
    words = "Profiles of the cams for roller followers, a panel for each law, undercut ones shaded"
    shown = picture(
        pictures["cams"](), words, "Dashed: the path of the roller's centre. Shaded: undercut, so it cannot be cut."
    )
    caption = f"Cams {quantity(study.scene.cam.breadth, 'm')} broad; marked where that is not broad enough"
    body = _to_cut(study) + shown + table(header, rows, caption, range(1, len(header))) + _roller_motors(study)
    return Section(
        "cams", "Cams", f"{len(study.cycles)} laws for {len(FOLLOWERS)} followers; one drawn to be cut.", body
    )


def _cam_row(law, cams):
    """Least breadths for each follower, and what a roller and a flat face must bear."""
    breadths = {name: quantity(cam.least_breadth().breadth, "m") for name, cam in cams.items()}
    told = [mark("bad", f"{breadths[name]}: undercut") if cams[name].undercut else breadths[name] for name in cams]
    roller, flat = cams["roller"], cams["flat"]
    angle = f"{np.degrees(roller.largest_pressure_angle):.1f}°"
    radius, width = roller.least_radius_of_curvature, flat.largest_contact_offset
    return escape(law), *told, quantity(radius, "m"), angle, quantity(width, "m")


def _roller_motors(study):
    """What each law asks of motors inside the rollers, where these and no cam drive the cart."""
    motors = study.roller_motors
    columns = {
        "law": [escape(law) for law in motors],
        "torque": column([motor.peak_torque for motor in motors.values()], "N\N{NO-BREAK SPACE}m"),
        "power": column([motor.peak_power for motor in motors.values()], "W"),
        "share of friction": [percent(motor.share) for motor in motors.values()],
    }
    if any(motor.roller.has_creep for motor in motors.values()):
        columns["creep"] = [percent(motor.peak_creep) for motor in motors.values()]
    if any(motor.lack for motor in motors.values()):
        columns["lack"] = [escape(motor.lack) for motor in motors.values()]
    caption = "Instead of a cam: the motor inside each roller at its peaks, and what friction must hold"
    return table_of(columns, caption, words=("law", "lack"))


def _to_cut(study):
    """Drawing and motion of the cam of the law that is first."""
    from compact.cams.export import moving
    from compact.cams.machining import cut
    from compact.cams.workshop_drawing import described, sheet

    places = next(iter(study.rankings.values()))
    law = places[0].run.name
    try:
        made = cut(study.cams[law, "roller"])
        drawing = sheet(made, study.scene.cam.bore)
    except ValueError as error:
        return paragraph(f"The cam of {escape(law)}, the first law, cannot be cut: {escape(str(error))}.")
    machine, words = study.scene.machine, f"The cam of {law} turns, and its followers carry the cart there and back"
    motion = moving(made.cam, machine.roller_radius, machine.roller_positions, escape(words))
    caption = f"{escape(law)}, true to scale in the file; <code>compact cam</code> writes it as CSV, SVG and DXF."
    turning = picture(motion.encode(), words, "One turn takes a whole cycle.", "svg")
    return (
        picture(drawing.svg(described(made)).encode(), described(made), caption, "svg")
        + f"<details><summary>Show the cam and the cart in motion</summary>{turning}</details>"
    )


def moves(shifts):
    """What moves the answer."""
    peaks = list(shifts[0].base.least)
    rows = [
        (
            escape(shift.name.split(".")[-1].replace("_", " ")), f"{_end(shift, 0)} to {_end(shift, 1)}",
            mark("assumed", shift.how) if shift.how == PRIOR else shift.how, escape(shift.by),
            *(_moved(end, shift.base, peak) for peak in peaks for end in (shift.low, shift.high)),
            escape(_others(shift)),
        )
        for shift in shifts
    ]  # fmt: skip
    ends = [f"{by.removeprefix('peak_')}, {end} end" for by in peaks for end in ("low", "high")]
    header = ("input", "moved from", "which is", "by", *ends, "first law")
    now = "; ".join(f"by {by}, {_as_it_is(base)}" for by, base in {each.by: each.base for each in shifts}.items())
    said = paragraph(
        f"One input after another is moved to its low and its high end, with a rigid drive. {_who(shifts)} The numbers "
        f"are what becomes of the least peak over all laws; as the scene is, that is, {now}."
    )
    body = said + table(header, rows, "What moves the answer", (1, 4, 5, 6, 7))
    return Section("sensitivity", "Sensitivity", f"What moves the answer, one input at a time. {means(shifts)}.", body)


def _who(shifts):
    """By what, and what that leaves out."""
    by = {shift.by for shift in shifts}
    if by == {"formula"}:
        return "All is by formula, which knows no speed."
    if "formula" in by:
        return (
            "What leaves the layer alone is by the engine's own map; for the rest formulas stand, as the engine would "
            "take too long."
        )
    return f"All is by the engine {escape(by.pop())}, rolled anew for each end, at steady speed."


def _as_it_is(base):
    return ", ".join(
        f"{WORDS[by]} {quantity(v, CRITERIA[by].unit)} ({escape(base.law[by])})" for by, v in base.least.items()
    )


def _end(shift, which):
    return quantity(shift.ends[which], shift.unit, 3)


def _moved(end, base, peak):
    """Change of a least peak at an end."""
    if end is None:
        return "beyond reach"
    change = end.least[peak] / base.least[peak] - 1
    return f"{'+' if change > ROUNDING else ''}{percent(change)}"


def _others(shift):
    """Laws that are first at an end, where they are not first as the scene is."""
    ends = [end for end in (shift.low, shift.high) if end]
    found = {end.law[by] for end in ends for by, law in shift.base.law.items() if law not in end.ties[by]}
    return ", ".join(sorted(found)) or "the same"


def scene(given):
    """The scene as it was read, what is assumed in it marked."""
    tables = [_keys(given, name) for name in type(given).model_fields if name not in ("title", "unusual", "output")]
    assumed = sum(part.count('class="mark assumed"') for part in tables)
    words = (
        f"Read from {escape(given.file)}, in SI units. Marked is what its comments call assumed, or the call changed."
    )
    lead = f"Every input, {assumed} of them assumed."
    return Section("scene", "Scene", lead, paragraph(words) + "".join(tables))


def _keys(given, name):
    part = getattr(given, name)
    if part is None:
        return ""
    rows = [
        (f"<code>{key}</code>", _value(getattr(part, key)), escape(field.description or ""), _remark(given, name, key))
        for key, field in type(part).model_fields.items()
        if getattr(part, key) is not None
    ]
    return table(("key", "value", "is", "remark in the file"), rows, f"[{name}]")


def _value(value):
    if hasattr(value, "model_dump"):
        given = value.model_dump(exclude_none=True)
        return escape(", ".join(f"{key} = {item}" for key, item in given.items()) or "none")
    if isinstance(value, tuple):
        return ", ".join(_value(item) for item in value)
    return f"{value:.10g}" if isinstance(value, float) else escape(str(value))


def _remark(given, table_name, key):
    """The comment of a key; the clause of it that tells where the number comes from is marked."""
    clauses = [clause.strip() for clause in given.remark(table_name, key).split(";")]
    for kind, signs in (("assumed", ASSUMED), ("known", KNOWN)):
        for sign in signs:
            told = next((clause for clause in clauses if clause.startswith(sign)), None)
            if told is not None:
                rest = [told.removeprefix(sign).strip(" :,"), *(clause for clause in clauses if clause != told)]
                return f"{mark(kind, sign)} {escape('; '.join(filter(None, rest)))}".rstrip()
    return escape("; ".join(clauses))


def built_in(found):
    """The built-in checks, as of `checks`."""
    rows = [
        (
            escape(check.name), number(check.residual, 2), number(check.limit, 2),
            mark("good", "holds") if check.passed else mark("bad", "fails"),
        )
        for check in found
    ]  # fmt: skip
    failed = sum(not check.passed for check in found)
    lead = f"{len(found)} balances and counts; {failed or 'none'} of them fail{'s' if failed == 1 else ''}."
    return Section(
        "checks", "Built-in checks", lead, table(("what", "left over", "allowed", ""), rows, "Checks", (1, 2))
    )
