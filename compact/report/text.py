"""Results as text: the digests that the commands print, and sentences that the page shares with them.

Numbers are in SI units with the unit in the text.
"""

import re
from collections.abc import Iterator, Sequence
from itertools import chain
from textwrap import wrap
from typing import Any

import numpy as np

from compact.analysis.engineering_summary import Number, coverage
from compact.analysis.ranking_uncertainty import Place
from compact.analysis.stages.comparison import resistances_without_wave
from compact.analysis.stages.laws import COMPLIANT_DRIVES
from compact.analysis.stages.model_spread import LawVariant
from compact.analysis.stages.verdict import FLOOR, VISCOELASTIC
from compact.analysis.study import Study
from compact.cams.profile import Cam
from compact.machine.ranking import CRITERIA
from compact.material.laws import HECKEL_MAX_DENSITY_RATIO
from compact.report.page import answer_text
from compact.report.sizing.duration_tables import duration_sentence
from compact.report.sizing.sentences import (
    bearing_sentence,
    margin_sentence,
    motor_sentence,
    work_sentence,
)
from compact.rolling_contact import ContactResult
from compact.scene.loader import Scene

TEXT_WIDTH = 118  # characters of a line, without its indent
WHOLE = 1000.0  # values from here on have no decimals
DIGEST_CRITERIA = 2  # [-], number of criteria in the digest, the first of the scene
DIGEST_NUMBER = "roller_force"
DIGEST_LINES = 38  # [-]; the digest and the line of the results fit 40 lines
PART_OF = re.compile(r" of \w+\)$")  # end of the share of a resistance in another
SHORT_REASONS = {VISCOELASTIC: "part", FLOOR: "floor"}  # in the terminal; a layer otherwise
LEFT_OUT = 2  # [-], last columns of the table of models that the page alone has
SHORT_CELLS = {  # words of the table of models in the terminal
    "discretisation error": "error", "mean resistance": "resistance",
    "least peak drive force": "least peak force", "least peak drive power": "least peak power",
}  # fmt: skip
BEST_LAWS = 3  # [-], laws of each criterion in the digest; the tables have all


def study_digest(study: Study) -> str:
    """Summarise a study: recommended laws, models, further questions, contact, and the best laws.

    Returns
    -------
    str
        At most DIGEST_LINES lines of TEXT_WIDTH characters; the last one counts the sentences that do not fit.
    """
    lines = [study.scene.title or "untitled scene"]
    for each in answer_text.recommendations(study):
        lines += _wrapped(each.sentence)
    lines += ["", *_model_lines(study), ""] if study.verdicts else [""]
    if not study.stages.contacts.engine.layered:
        lines.append(_number_line(DIGEST_NUMBER, study.stages.contacts.numbers[DIGEST_NUMBER]))
    waiting = [found for sentence in _digest_sentences(study) if (found := _wrapped(sentence))]
    while waiting and len(lines) + len(waiting[0]) < DIGEST_LINES:
        lines += waiting.pop(0)
    if waiting:
        lines.append(f"  {len(waiting)} more in report.html and summary.json")
    return "\n".join(lines)


def _digest_sentences(study: Study) -> Iterator[str]:
    """List the sentences of the digest, the most important first; some are empty."""
    yield from answer_text.limit_sentences(study)
    yield from answer_text.duration_lines(study)
    yield from (answer_text.stiffness_sentence(study), answer_text.measurement_sentence(study), spread_sentence(study))
    yield from (motor_sentence(study.machine_sizing), margin_sentence(study))
    yield from heaping_sentences(study)
    yield from (f"not made: {name}: {reason}" for name, reason in study.stages.laws.not_made.items())
    yield from (study.mix.density_achievable.reason, held_sentence(study), sleeve_sentence(study))
    yield from (return_sentence(study), air_sentence(study))
    yield "" if study.over_durations is None else duration_sentence(study.over_durations)
    yield from _best_lines(study)
    yield guide_sentence(study).partition("; for comparison")[0]
    yield from (
        coverage(study.scene, study.stages.contacts.engineering),
        bearing_sentence(study.machine_sizing),
        work_sentence(study),
    )
    fits = study.scene.mix.fit_remark
    yield from (each for each in chain(*study.scene.replacements.values()) if not fits or fits not in each)


def contact_digest(study: Study, speed: float, passes: Sequence[ContactResult]) -> str:
    """Summarise one contact against the formulas and the exact half-plane, with all its passes.

    Parameters
    ----------
    speed : float
        Speed of the roller [m/s].
    """
    first, engine, machine = passes[0], study.scene.accuracy.engine, study.scene.machine
    lines = [f"{'at ' + format(speed, 'g') + ' m/s':<20}{engine:>12}{'eqs 1.5-1.8':>14}{'Galin':>12}"]
    for name, *values in _contact_rows(study, first):
        computed, formula, exact = (f"{value:.5g}" if np.isfinite(value) else "-" for value in values)
        lines.append(f"{name:<20}{computed:>12}{formula:>14}{exact:>12}")
    lines.append(f"a roller is {machine.roller_length:g} m long, the cart has {machine.rollers}")
    if first.error:
        lines += _accuracy_lines(first)
    if study.stages.contacts.held is not None:
        lines.append(held_sentence(study))
    lines += study.scene.replacements[engine]
    air = study.stages.contacts.air_forces_of(first, speed)
    if air is not None:
        lines.append(
            f"without pore air, whose pressure at this deformation adds {air.load:.4g} N/m to the load and "
            f"{air.resistance:.4g} N/m to the resistance; {air.excess_behind / 1e3:.3g} kPa remain behind the roller"
        )
    if len(passes) > 1:
        lines += ["", "pass   load [N/m]   resistance [N/m]   exit height [mm]   density ratio"]
        lines += [_pass_line(number, each) for number, each in enumerate(passes, start=1)]
    return "\n".join(lines)


def cam_digest(law: str, cam: Cam) -> str:
    """Summarise the dimensions of one cam."""
    least = cam.least_breadth()
    return "\n".join([
        f"cam for {law}, {type(cam.follower).__name__}, breadth {cam.breadth:g} m{' UNDERCUT' * cam.undercut}",
        f"  least breadth                 {least.breadth:.6g} m: {least.rule}",
        f"  least radius of curvature     {cam.least_radius_of_curvature:.6g} m",
        f"  largest pressure angle        {np.degrees(cam.largest_pressure_angle):.2f} deg",
        f"  largest offset of the contact {cam.largest_contact_offset:.6g} m",
    ])  # fmt: skip


def held_sentence(study: Study) -> str:
    """State the quantity of the contact that is constant over speed.

    Returns
    -------
    str
        One sentence without a full stop; empty for the engine "formula".
    """
    held = study.stages.contacts.held
    if held is None:
        return ""
    quantity = {
        "height": f"the height of the roller, {held.value * 1e3:.4g} mm deep",
        "load": f"the load, {held.value * study.scene.machine.roller_length:.4g} N on a roller",
        "peak_pressure": f"the peak pressure, {held.value / 1e3:.4g} kPa",
    }[held.name]
    return f"constant over speed: {quantity}, determined at {held.speed:.4g} m/s for {_target(study)}"


def sleeve_sentence(study: Study) -> str:
    """State the part of the feed sleeves in the resistance of a forming process, which follows from an assumed head.

    Returns
    -------
    str
        One sentence without a full stop; empty without feed sleeves.
    """
    process = study.stages.contacts.process
    if process is None or not process.sleeve_drag:
        return ""
    return (
        f"feed sleeves: their drag, {process.sleeve_drag:.4g} N on a cart, is part of the resistance; it follows from "
        "sleeve.head, which counts as full at every stroke, and has no error estimate"
    )


def heaping_sentences(study: Study) -> Iterator[str]:
    """State each engine of the comparison without a steady state: mix heaps up, no steady motion, no equilibrium.

    Yields
    ------
    str
        One sentence without a full stop.
    """
    for name, error in study.heaping.items():
        found = error.heaping
        angle = f"contact angle of {np.degrees(found.contact_angle):.3g} degrees"
        depth = "under the prescribed load" if found.depth is None else f"at a depth of {found.depth * 1e3:.3g} mm"
        wave = f"by an estimate before any finite elements it exceeds a {angle}"
        if found.wave_height is not None and found.travel is not None:
            height = f"{found.wave_height * 1e3:.3g} mm"
            wave = f"after {found.travel:.3g} m of travel the bow wave is {height} high, a {angle}"
        yield (
            f"{name}: the mix heaps up in front of the roller, no steady state {depth}; {wave}; reason and remedies in "
            "summary.json (heaping)"
        )
    for name, unsteady in study.unsteady.items():
        contact = unsteady.unsteady
        yield (
            f"{name}: not steady at a depth of {contact.depth * 1e3:.3g} mm after {contact.travel:.3g} m of travel, "
            f"estimated distance {100 * contact.distance:.2g} %; load {contact.load:.4g} N/m, resistance "
            f"{contact.resistance:.4g} N/m, bow wave {contact.wave_height * 1e3:.3g} mm; reason and remedies in "
            "summary.json (unsteady)"
        )
    for name in study.without_equilibrium:
        yield f"{name}: no equilibrium, so that it has no resistance; reason in summary.json (no_equilibrium)"


def other_resistances(scene: Scene) -> str:
    """State the resistance of a cart at the mean speed by the engines that have one where the mix heaps up.

    Returns
    -------
    str
        A clause with the option that ranks the laws by such an engine.
    """
    found = resistances_without_wave(scene)
    values = ", ".join(f"{force:.4g} N by {name}" for name, force in found.items())
    return f"resistance of a cart at the mean speed, without a bow wave: {values}; --engine {[*found][-1]} ranks by it"


def return_sentence(study: Study) -> str:
    """State the mix under the return stroke, with the energy per cycle where both states are computed.

    Returns
    -------
    str
        One sentence without a full stop.
    """
    if not study.stages.drive.cycle_energies or study.stages.contacts.second_pass is None:
        if study.stages.contacts.engine.forming:
            load, resistance = study.stages.contacts.return_ratios
            return f"return stroke: {load:.1%} of the load and {resistance:.1%} of the resistance of the forward stroke"
        reason = (
            "a linear layer recovers" if study.stages.contacts.engine.layered else "the formulas have no other state"
        )
        return f"return stroke: over fresh mix, with the resistance of the forward stroke ({reason})"
    load, resistance = study.stages.contacts.second_pass
    fresh, compacted = (study.stages.drive.cycle_energies[state] for state in ("fresh", "compacted"))
    return (
        f"return stroke: over {study.scene.layer.return_stroke} mix; over compacted mix it requires {load:.1%} of the "
        f"load and {resistance:.1%} of the resistance; energy per cycle with {study.stages.drive.best_law}: "
        f"{fresh:.4g} J over fresh mix, {compacted:.4g} J over compacted mix"
    )


def air_sentence(study: Study) -> str:
    """State the part of the pore air in load and resistance, the de-aeration speed and the tension behind the roller.

    Returns
    -------
    str
        One sentence without a full stop; empty for a layer without compaction.
    """
    air, model = study.pore_air, study.scene.mix.pore_air
    if not study.stages.contacts.engine.compacting:
        return ""
    if study.stages.contacts.engine.forming:
        return _air_of_process(study)
    if air is None:
        return (
            "pore air: the fed mix is occluded, so that its permeability does not apply; load and resistance have none"
        )
    load, resistance = air.shares
    words = (
        "drained, not part of load and resistance" if model == "drained" else f"{model}, part of load and resistance"
    )
    value, low, high = ("no" if each is None else f"{each:.2g}" for each in air.deaeration_speeds)
    band = "" if low == high else f" ({low} to {high} m/s over the spread of the permeability)"
    sentence = (
        f"pore air: {words}; at the mean speed and {air.permeability.value:.2g} m2 it adds {100 * load:.2g} % to the "
        f"load and {100 * resistance:.2g} % to the resistance; it adds a tenth of the load at {value} m/s{band}"
    )
    if study.stages.contacts.engine.name == "compaction" and model != "coupled":
        sentence += (
            ", at the deformation without air; where a bow wave exists, coupled contacts have several times as much"
        )
    if not air.may_crack:
        return sentence
    behind, strength = air.at_mean_speed.excess_behind / 1e3, air.tensile_strength / 1e3
    exceeded = f"behind the roller {behind:.3g} kPa exceed the tensile strength {strength:.3g} kPa"
    return f"{sentence}; {exceeded}, so that the surface may crack"


def _air_of_process(study: Study) -> str:
    """State the part of the pore air in the strokes of a process."""
    process = study.stages.contacts.process
    found = None if process is None else process.two_dimensions
    if process is None or found is None or process.pore_air is None:
        return "pore air: not computed by columns, nor of mix that is occluded as fed"
    part = "part of load and resistance" if process.counts_air else "drained, not part of load and resistance"
    return (
        f"pore air: {part}; at the mean speed it adds {found.air_load.value / found.load.value:.1%} to the load and "
        f"{found.air_resistance.value / found.resistance.value:.1%} to the resistance of a roller, without sleeves"
    )


def spread_sentence(study: Study) -> str:
    """State the spread of load and resistance over the laws of the mix.

    Returns
    -------
    str
        One sentence without a full stop; empty for an engine without compaction.
    """
    if not study.stages.contacts.engine.compacting:
        return ""
    spread = study.model_spread
    if spread is None:
        return 'spread over the laws of the mix: not computed; add "model_spread" to output.items'
    bands = " and ".join(
        f"{name} {low:.2f} to {high:.2f} times"
        for name, (low, high) in zip(("load", "resistance"), (spread.load, spread.resistance), strict=True)
    )
    heaped = [each for each in spread.variants if each.heaping is not None]
    failed = [each for each in spread.variants if each.load is None and each.heaping is None]
    sentence = f"spread over the laws of the mix: {bands} those above"
    if study.stages.contacts.engine.name == "column":
        sentence += "; confined compression has no bow wave, on which the laws differ most"
    if heaped:
        sentence += f"; no steady state, the mix heaps up: {_names(heaped)}"
    return sentence + (f"; no solution: {_names(failed)}" if failed else "")


def _names(variants: list[LawVariant]) -> str:
    """Name the laws of some variants with their cohesion of loose mix and the wave, if it was computed."""
    found = []
    for each in variants:
        words = each.law if each.cohesion_loose is None else f"{each.law} at {each.cohesion_loose / 1e3:.3g} kPa"
        heaping = each.heaping
        if heaping is not None and heaping.wave_height is not None and heaping.travel is not None:
            words += f" (wave {heaping.wave_height * 1e3:.3g} mm after {heaping.travel:.2g} m)"
        found.append(words)
    return ", ".join(found)


def guide_sentence(study: Study) -> str:
    """State the drive force at the mean speed, its guide friction, and the value of eq 1.9.

    Returns
    -------
    str
        One sentence without a full stop.
    """
    steady, formula = study.stages.resistance.steady, study.stages.contacts.engineering
    force, guides = (float(each[0]) for each in (steady.drive_force, steady.guide_friction))
    return (
        f"drive force at the mean speed: {force:.4g} N, of which {guides:.3g} N at the guide wheels (guide_friction "
        f"{study.scene.machine.guide_friction:g}); for comparison, eq 1.9 gives {formula.cart_resistance:.4g} N with "
        f"the coefficient {formula.guide_coefficient:.3g} of the guide wheels from journal, rolling arm and rib; the "
        "drives do not use it"
    )


def _wrapped(text: str) -> list[str]:
    return [f"  {line}" for line in wrap(text, TEXT_WIDTH)]


def _number_line(name: str, number: Number) -> str:
    spread = ""
    if number.low is not None:
        high = "beyond the range of the formulas" if number.high is None else f"{number.high:.4g}"
        spread = f"   {number.low:.4g} to {high} over the spread of the mix"
    return f"  {name.replace('_', ' '):<24}{number.value:>10.4g} {number.unit:<4}{spread}"


def _model_lines(study: Study) -> Iterator[str]:
    """List the models in columns of equal width."""
    rows = [[name, _short_validity(valid), *cells] for name, valid, *cells in answer_text.model_table(study)]
    table = [[PART_OF.sub(")", SHORT_CELLS.get(cell, cell)) for cell in row[:-LEFT_OUT]] for row in rows]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    for row in table:
        yield "  " + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()


def _short_validity(cell: str) -> str:
    """Shorten the reason why a model may not size a drive; the page has it in full."""
    valid, _, fitted = cell.partition("; ")
    if valid.startswith("no: "):
        valid = f"no ({SHORT_REASONS.get(valid[4:], 'layer')})"
    return f"{valid}, {fitted}" if fitted else valid


def _best_lines(study: Study) -> Iterator[str]:
    """List the best laws by the first criteria with the drive of the scene, a sentence for each criterion."""
    kind, engine = study.scene.drive.kind, study.scene.accuracy.engine
    for by, order in list(study.stages.drive.places[kind].items())[:DIGEST_CRITERIA]:
        term, unit = CRITERIA[by].quantity.term, CRITERIA[by].unit
        best = "; ".join(_place_words(place, study.runs.get(place.law), kind) for place in order[:BEST_LAWS])
        yield f"laws by {term} [{unit}], {engine}, {kind} drive: {best}"


def _place_words(place: Place, run: Any, kind: str) -> str:
    """State rank, value, dynamic amplification and margin of a law, with "?" where the rank is not resolved."""
    if place.reason:
        return f"{place.law} infinite: {place.reason}"
    margin = " (tie with the next)" if place.tie else ""
    unresolved = "" if place.resolved in (True, None) or place.tie else " ?"
    amplification = getattr(run, "dynamic_amplification", np.nan) if kind in COMPLIANT_DRIVES else np.nan
    amplified = f", amplification {amplification:.2f}" if np.isfinite(amplification) else ""
    return f"{place.rank} {place.law} {place.value:.{0 if place.value >= WHOLE else 1}f}{amplified}{margin}{unresolved}"


def _contact_rows(study: Study, contact: ContactResult) -> list[tuple[str, Any, Any, Any]]:
    """List (label, computed, by formula, exact) of one contact."""
    formulas, exact, length = (
        study.stages.contacts.engineering,
        study.stages.contacts.exact,
        study.scene.machine.roller_length,
    )
    resistance, radius = formulas.roller_resistance, study.scene.machine.roller_radius
    return [
        ("load [N/m]", contact.load, formulas.roller_force / length, exact.load),
        ("  a roller [N]", contact.load * length, formulas.roller_force, exact.load * length),
        ("resistance [N/m]", contact.resistance, resistance / length, np.nan),
        ("  a roller [N]", contact.resistance * length, resistance, np.nan),
        ("resistance/load", contact.resistance / contact.load, formulas.resistance_coefficient, np.nan),
        ("contact length [m]", contact.leading - contact.trailing, formulas.contact_length, exact.contact_length),
        ("leading edge [m]", contact.leading, radius * np.sin(formulas.capture_angle), exact.leading),
        ("peak pressure [Pa]", contact.peak_pressure, formulas.pressure, exact.peak_pressure),
    ]


def _accuracy_lines(contact: Any) -> Iterator[str]:
    """State error estimates, the exit density ratio of a compacting layer, and the balances."""
    if contact.error is None:
        yield "no error estimate of load and resistance: one mesh alone"
    else:
        yield f"error estimate of the load {contact.error[0]:.1e}, of the resistance {contact.error[1]:.1e}"
    if contact.error is not None and hasattr(contact, "error_parts"):
        parts = contact.error_parts
        yield "of it " + ", ".join(
            f"{name} {load:.1e} and {resistance:.1e}"
            for name, (load, resistance) in (("mesh", parts.mesh), ("drift", parts.drift), ("start", parts.start))
        )
    if hasattr(contact, "exit_density_ratio"):
        yield (
            f"density ratio {contact.exit_density_ratio:.4f} behind the roller, exit height "
            f"{contact.exit_height * 1e3:.2f} mm; mass-balance residual {abs(contact.mass_residual):.1e}"
        )
    if getattr(contact, "lower_height", None) is not None:
        yield (
            f"lower lift behind the roller: density ratio {contact.lower_density_ratio:.4f}, height "
            f"{contact.lower_height * 1e3:.3f} mm"
        )
    if getattr(contact, "exceeds_full_density", False):
        yield f"over-compacted: the mix exceeds full density, density ratio {contact.peak_density_ratio:.3f} at most"
    if getattr(contact, "overdense_work", 0.0) > 0:
        yield (
            f"{contact.overdense_work:.0%} of the plastic work at density ratios above {HECKEL_MAX_DENSITY_RATIO}, "
            "where the pressure curve is extrapolated"
        )
    yield f"energy-balance residual {contact.work_residual:.1e}; {_effort(contact)}"


def _effort(contact: Any) -> str:
    """State the number of evaluations, iterations or steps of an engine."""
    if hasattr(contact, "evaluations"):
        return f"evaluations: {contact.evaluations}"
    solution = getattr(contact, "solution", None)
    if solution is None:
        return f"iterations: {len(contact.history)}"
    return (
        f"force residual {contact.equilibrium_residual:.1e}; {len(solution.steps)} steps on the last mesh; bow wave "
        f"{contact.bow_wave * 1e3:.2f} mm"
    )


def _pass_line(number: int, contact: Any) -> str:
    """List one pass; the resistance is positive against the travel of either direction."""
    resistance = contact.resistance if number % 2 else -contact.resistance
    return (
        f"{number:>4}{contact.load:>13.5g}{resistance:>19.4g}{contact.exit_height * 1e3:>19.2f}"
        f"{contact.exit_density_ratio:>16.4f}"
    )


def _target(study: Study) -> str:
    """Name the target that the contact reaches at the mean speed."""
    for name, value in study.scene.target.items():
        return {
            "indentation": f"the prescribed indentation of {value * 1e3:.4g} mm",
            "load": f"the prescribed load of {value:.4g} N on a roller",
            "peak_pressure": f"the prescribed peak pressure of {value / 1e3:.4g} kPa",
        }[name]
    if study.stages.contacts.engine.compacting:
        return f"the density ratio {study.scene.mix.density_ratio:g} of the product"
    return f"the peak pressure of {study.mix.required_pressure / 1e3:.4g} kPa that the density requires"
