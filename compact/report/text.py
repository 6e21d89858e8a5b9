"""Results as text: the digests that the commands print, and sentences that the page shares with them.

Numbers are in SI units with the unit in the text.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from textwrap import wrap
from typing import Any

import numpy as np

from compact.analysis.engineering_summary import Number, coverage
from compact.analysis.ranking_uncertainty import Place
from compact.analysis.stages.comparison import resistances_without_wave
from compact.analysis.stages.laws import COMPLIANT_DRIVES
from compact.analysis.stages.model_spread import LawVariant
from compact.analysis.study import Study
from compact.cams.profile import Cam
from compact.machine.ranking import CRITERIA
from compact.material.laws import HECKEL_MAX_DENSITY_RATIO
from compact.report import ranking_tables
from compact.report.sizing.duration_tables import duration_sentence
from compact.report.sizing.sentences import bearing_sentence, motor_sentence, work_sentence, work_warnings
from compact.rolling_contact import ContactResult
from compact.scene.loader import Scene

TEXT_WIDTH = 116  # characters of a line
DIGEST_CRITERIA = 2  # [-], number of criteria in the digest, the first of the scene
DIGEST_NUMBERS = ("capture_angle", "contact_length", "roller_force", "resistance_coefficient")


def study_digest(study: Study) -> str:
    """Summarise a study: contact, forces, and the laws by the first criteria."""
    lines = [study.scene.title or "untitled scene", ""]
    lines += [_number_line(name, study.numbers[name]) for name in DIGEST_NUMBERS]
    lines += [*_wrapped(coverage(study.scene, study.engineering)), ""]
    for state in (held_sentence, return_sentence, air_sentence, spread_sentence, guide_sentence):
        lines += _wrapped(state(study))
    sizing = (motor_sentence(study.machine_sizing), bearing_sentence(study.machine_sizing))
    for sentence in (work_sentence(study), *work_warnings(study.work_balance), *sizing):
        lines += _wrapped(sentence)
    if not study.mix.density_achievable:
        lines.append(f"  {study.mix.density_achievable.reason}")
    for sentence in chain(*study.scene.replacements.values()):
        lines += _wrapped(sentence)
    lines += _ranking_lines(study)
    if study.over_durations is not None:
        lines += ["", *_wrapped(duration_sentence(study.over_durations))]
    if study.laws_not_made:
        lines += ["", *(f"not made: {name}: {reason}" for name, reason in study.laws_not_made.items())]
    lines += ["", *_agreement_lines(study)]
    for sentence in heaping_sentences(study):
        lines += _wrapped(sentence)
    return "\n".join(lines)


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
    if study.held is not None:
        lines.append(held_sentence(study))
    lines += study.scene.replacements[engine]
    air = study.contact_stage.air_forces_of(first, speed)
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
    held = study.held
    if held is None:
        return ""
    quantity = {
        "height": f"the height of the roller, {held.value * 1e3:.4g} mm deep",
        "load": f"the load, {held.value * study.scene.machine.roller_length:.4g} N on a roller",
        "peak_pressure": f"the peak pressure, {held.value / 1e3:.4g} kPa",
    }[held.name]
    return f"constant over speed: {quantity}, determined at {held.speed:.4g} m/s for {_target(study)}"


def heaping_sentences(study: Study) -> Iterator[str]:
    """State each engine of the comparison without a steady state: the mix heaps up, or the motion is not steady.

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
    if not study.cycle_energies or study.second_pass is None:
        reason = "a linear layer recovers" if study.layered else "the formulas have no other state"
        return f"return stroke: over fresh mix, with the resistance of the forward stroke ({reason})"
    load, resistance = study.second_pass
    fresh, compacted = (study.cycle_energies[state] for state in ("fresh", "compacted"))
    return (
        f"return stroke: over {study.scene.layer.return_stroke} mix; over compacted mix it requires {load:.1%} of the "
        f"load and {resistance:.1%} of the resistance; energy per cycle with {study.drive_stage.best_law}: {fresh:.4g} "
        f"J over fresh mix, {compacted:.4g} J over compacted mix"
    )


def air_sentence(study: Study) -> str:
    """State the part of the pore air in load and resistance, the de-aeration speed and the tension behind the roller.

    Returns
    -------
    str
        One sentence without a full stop; empty for a layer without compaction.
    """
    air, model = study.pore_air, study.scene.mix.pore_air
    if not study.engine.compacting:
        return ""
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
    if study.engine.name == "compaction" and model != "coupled":
        sentence += (
            ", at the deformation without air; where a bow wave exists, coupled contacts have several times as much"
        )
    if not air.may_crack:
        return sentence
    behind, strength = air.at_mean_speed.excess_behind / 1e3, air.tensile_strength / 1e3
    exceeded = f"behind the roller {behind:.3g} kPa exceed the tensile strength {strength:.3g} kPa"
    return f"{sentence}; {exceeded}, so that the surface may crack"


def spread_sentence(study: Study) -> str:
    """State the spread of load and resistance over the laws of the mix.

    Returns
    -------
    str
        One sentence without a full stop; empty for an engine without compaction.
    """
    if not study.engine.compacting:
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
    if study.engine.name == "column":
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
    steady, formula = study.steady, study.engineering
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
    spread = "" if number.low is None else f"   {number.low:.4g} to {number.high:.4g} over the spread of the mix"
    return f"  {name.replace('_', ' '):<24}{number.value:>10.4g} {number.unit:<4}{spread}"


def _ranking_lines(study: Study) -> Iterator[str]:
    """List the laws by the first criteria for each drive."""
    engine = study.scene.accuracy.engine
    for kind, orders in study.places.items():
        compliant = kind == study.scene.drive.kind and kind in COMPLIANT_DRIVES
        for by, order in list(orders.items())[:DIGEST_CRITERIA]:
            others = ranking_tables.comparison_places(study, kind, by)
            yield ""
            yield f"laws by {CRITERIA[by].quantity.term} [{CRITERIA[by].unit}], {engine}, {kind} drive"
            if others:
                yield f"{'':>66}{''.join(f'{name:>18}' for name in others)}".rstrip()
            for place in order:
                yield _place_line(place, study.runs.get(place.law) if compliant else None, others)


def _place_line(place: Place, run: Any, others: Mapping[str, Mapping[str, Place]]) -> str:
    """List rank, value, dynamic amplification, margin ("?" where the rank is not resolved) and ranks by engines."""
    if place.reason:
        return f"  {place.rank:>2}  {place.law:<30}  infinite: {place.reason}"
    margin = f"+{place.margin:.2%} to the next" if np.isfinite(place.margin) else ""
    margin = "tie with the next" if place.tie else margin
    unresolved = "" if place.resolved in (True, None) or place.tie else " ?"
    amplification = getattr(run, "dynamic_amplification", np.nan)
    amplified = f"amplification {amplification:.3f}   " if np.isfinite(amplification) else ""
    compared = (order.get(place.law) for order in others.values())
    values = "".join(f"{other.value:>13.1f} ({other.rank:>2})" if other else f"{'':>18}" for other in compared)
    value = f"  {place.rank:>2}  {place.law:<30}{place.value:>10.1f}"
    return f"{value}   {amplified}{margin + unresolved:<22}{values}".rstrip()


def _agreement_lines(study: Study) -> Iterator[str]:
    """State the agreement of the rankings, a line for each comparison and criterion."""
    criteria = list(study.rankings)[:DIGEST_CRITERIA]
    for each in study.agreements if study.comparison else []:
        if each.by not in criteria:
            continue
        case = f"{each.other_engine} and {each.engine}, {each.drive} drive"
        if each.other_engine == each.engine:
            case = f"{each.engine}, {each.other_drive} and {each.drive} drive"
        found = each.agreement
        same = "same first law" if each.first == each.other_first else f"first {each.other_first}, not {each.first}"
        yield (
            f"  {CRITERIA[each.by].quantity.term}, {case}: {found.discordant_pairs} of {found.pairs} pairs discordant, "
            f"{found.resolved_discordant_pairs} beyond the errors, Kendall's tau {found.tau:.3f}; {same}"
        )


def _contact_rows(study: Study, contact: ContactResult) -> list[tuple[str, Any, Any, Any]]:
    """List (label, computed, by formula, exact) of one contact."""
    formulas, exact, length = study.engineering, study.exact, study.scene.machine.roller_length
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
    if study.engine.compacting:
        return f"the density ratio {study.scene.mix.density_ratio:g} of the product"
    return f"the peak pressure of {study.mix.required_pressure / 1e3:.4g} kPa that the density requires"
