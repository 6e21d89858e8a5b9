"""Sentences on the machine that terminal and page share: balances of work and mix, motor, and lives of bearings."""

import math

from compact.analysis.sizing.machine_sizing import MachineSizing
from compact.analysis.sizing.work_balance import WorkBalance
from compact.analysis.study import Study

POWER = "peak_power"  # criterion whose margin the motor is compared with


def work_sentence(study: Study) -> str:
    """State the work of a pass and of confined compression, and the mix pressed against the mix carried away.

    Returns
    -------
    str
        One sentence without a full stop.
    """
    balance = study.work_balance
    before, behind = balance.density_ratios
    sentence = (
        f"specific work of a pass over fresh mix: {_kilojoules(balance.pass_work)} of product; confined compression "
        f"from {before:.4g} to {behind:.4g} takes {_kilojoules(balance.confined_work)}"
    )
    litres = f"{1e3 * balance.pressed_volume:.3g} l of product"
    if balance.carried_volume is None:
        return f"{sentence}; a stroke presses {litres}, without product.mould_speed not compared with the throughput"
    return (
        f"{sentence}; a stroke over fresh mix presses {litres}, the mould carries {1e3 * balance.carried_volume:.3g} l "
        f"away in that time; at this throughput the resistance takes {_kilojoules(balance.throughput_work)} of product"
    )


def work_warnings(balance: WorkBalance) -> list[str]:
    """State the balances that do not fit.

    Returns
    -------
    list of str
        Sentences without full stops.
    """
    found = []
    if balance.recovers and balance.work_ratio is not None:
        found.append(
            f"the work of a pass is {balance.work_ratio:.2g} of that of confined compression: the engine has the "
            "viscoelastic part only; its forces are not for sizing"
        )
    ratio, share = balance.feed_ratio, balance.explained_share
    if balance.fits is False and ratio is not None and share is not None:
        if ratio > 1:
            found.append(
                f"mix fed and throughput do not fit: every stroke presses fresh mix, {ratio:.3g} times the mix that "
                "the mould carries away; the forces are those of a pass over fresh mix, and confined compression from "
                f"the loose state is {100 * share:.2g} % of their work at this throughput"
            )
        else:
            found.append(
                f"mix fed and throughput do not fit: the rollers press {ratio:.2g} of the mix that the mould carries "
                "away, so that the rest remains uncompacted; a slower mould or faster strokes would fit"
            )
    return found


def _hours(hours: float) -> str:
    """Format a life with two digits, without an exponent."""
    return "infinite" if math.isinf(hours) else f"{float(f'{hours:.2g}'):.0f} h"


def _kilojoules(work: float | None) -> str:
    return "–" if work is None else f"{work / 1e3:.3g} kJ/m³"


def motor_sentence(sizing: MachineSizing) -> str:
    """State the torque of the shaft under the first law, the required rated power and the motor of the catalogue.

    Returns
    -------
    str
        One sentence without a full stop; empty for a drive without a shaft.
    """
    first = sizing.first
    if first is None or first.requirement is None:
        return ""
    found, rule = first.requirement, sizing.rule
    gear = "" if rule.efficiency == 1 else f" and a gear of {100 * rule.efficiency:g} %"
    sentence = (
        f"motor with {first.law}: shaft at {found.speed:.3g} rad/s, rms torque {found.rms_torque:.4g} N m, peak "
        f"{found.peak_torque:.4g} N m; rated power at least {first.required_power:.4g} W with a margin of "
        f"{rule.margin:g}{gear}"
    )
    if first.choice is None:
        return sentence
    chosen, smaller = first.choice.chosen, first.choice.next_smaller
    failed = "" if smaller is None else f"{smaller.motor.name}, {' and '.join(smaller.failures)}"
    if chosen is None:
        return f"{sentence}; no motor of the catalogue holds; the largest, {failed}"
    price = "" if chosen.motor.price is None else f", price {chosen.motor.price:g}"
    sentence += (
        f"; smallest motor by {first.choice.by} that holds: {chosen.motor.name}, {chosen.motor.rated_power:.4g} W"
        f"{price}, gear ratio {chosen.gear_ratio:.4g}, inertia ratio {chosen.inertia_ratio:.3g}"
    )
    return f"{sentence}; the next smaller, {failed}" if failed else sentence


def margin_sentence(study: Study) -> str:
    """State that the margin of the motor is below that of the models and the mix on the peak power.

    Returns
    -------
    str
        One sentence without a full stop; empty for a sufficient margin, and without the uncertainty of the result.
    """
    known, margin = study.uncertainty, study.machine_sizing.rule.margin
    if known is None or study.machine_sizing.first is None or POWER not in known.peaks:
        return ""
    required = 1 + known.margin(POWER)
    if margin >= required or math.isnan(required):
        return ""
    return (
        f"the margin of the motor, {margin:g}, is a service factor and below that of models and mix, {required:.3g} of "
        f"the peak power; drive.catalogue.margin = {math.ceil(100 * required) / 100:g} covers it"
    )


def bearing_sentence(sizing: MachineSizing) -> str:
    """State the lives of the bearings.

    Returns
    -------
    str
        One sentence without a full stop; empty without ratings in the scene.
    """
    lives = [
        f"{name} {_hours(life.hours)}"
        + ("" if life.valid else " (beyond ISO 281: the load exceeds half of the rating)")
        for name, life in sizing.lives.items()
    ]
    return f"basic life L10 of the bearings with {sizing.first_law}: {', '.join(lives)}" if lives else ""
