"""Balances of work and mix that a designer can check: specific work of the drive, and mix fed against mix carried away.

Residuals that vanish for an exact solution come last, each with its limit: balances of energy, mass and forces of every
contact, of energy of every cycle, and the constant breadth of every cam. The engines satisfy the same limits in their
own tests.

A pass over fresh mix presses the strips of all rollers, n s L, from the initial density ratio to that of the product:

    work of a pass        F/(n L h)                        over the volume of product that it presses
    confined compression  k int s_v(k') dk'/k'^2           of the same volume of the same mix, without lateral strain
    mix pressed           n s L h                          in a stroke over fresh mix, as product
    mix carried away      v_mould (T + dwell) B h0         in the same time, by the mould
    work at throughput    work of a cycle over the mix carried away in a cycle

The strokes of a forming process press what the mould carries away, from the density ratio of the feed.

F is the resistance of the mix to one cart at its mean speed, h the lift thickness, s_v the vertical stress of Heckel's
curve at rest. A pass requires at least the confined work of its mix; a linear layer requires less, as it recovers. If
the rollers press more fresh mix than the mould carries away, the forces are those of a pass over fresh mix, not of the
forming process at this throughput, where all passes together compress the mix from its loose state once.
"""

from typing import NamedTuple

import numpy as np
from scipy.integrate import quad

from compact.analysis.stages.drives import Stages
from compact.analysis.stages.resistance import force_at
from compact.material.laws import MEASURED_DENSITY_RATIO
from compact.material.mix import LOOSE_DENSITY_RATIO

FEED_TOLERANCE = 0.1  # [-], of the mix pressed over the mix carried away; feeders are adjusted no better


class WorkBalance(NamedTuple):
    """Specific work and mix of one cart under the first law.

    Parameters
    ----------
    law : str
        Name of the first law by the first criterion.
    density_ratios : tuple of float
        Initial density ratio and that behind the pass [-].
    pass_work : float
        Work of one pass over fresh mix, over the volume of product [J/m3].
    confined_work : float
        Work of confined compression between the density ratios, over the volume of product [J/m3].
    loose_work : float
        Work of confined compression from the loose state, the start of Heckel's curve [J/m3].
    cycle_work : float
        Work of the resistance of the mix in a cycle [J].
    pressed_volume : float
        Product that the rollers press from fresh mix in a stroke [m3].
    fresh_strokes : int
        Strokes over fresh mix in a cycle, 1 or 2.
    carried_volume : float or None
        Product that the mould carries away in the time of a stroke [m3]; None without `product.mould_speed`.
    strokes_on_section : float or None
        Strokes during which a section of the product is under the rollers [-]; None likewise.
    """

    law: str
    density_ratios: tuple[float, float]
    pass_work: float
    confined_work: float
    loose_work: float
    cycle_work: float
    pressed_volume: float
    fresh_strokes: int
    carried_volume: float | None = None
    strokes_on_section: float | None = None

    @property
    def work_ratio(self) -> float | None:
        """Work of a pass over that of confined compression [-]; None for a pass without compaction."""
        return self.pass_work / self.confined_work if self.confined_work > 0 else None

    @property
    def throughput_work(self) -> float | None:
        """Work of a cycle over the product that the mould carries away in it [J/m3]; None without its speed."""
        return None if self.carried_volume is None else self.cycle_work / (2 * self.carried_volume)

    @property
    def feed_ratio(self) -> float | None:
        """Mix pressed over mix carried away in a cycle [-]; None without the speed of the mould."""
        if self.carried_volume is None:
            return None
        return self.fresh_strokes * self.pressed_volume / (2 * self.carried_volume)

    @property
    def explained_share(self) -> float | None:
        """Share of the work at throughput that confined compression from the loose state requires [-], or None."""
        return None if self.throughput_work is None else self.loose_work / self.throughput_work

    @property
    def fits(self) -> bool | None:
        """True if the mix pressed is the mix carried away, within FEED_TOLERANCE; None without the mould's speed."""
        return None if self.feed_ratio is None else abs(self.feed_ratio - 1) <= FEED_TOLERANCE


def work_balance(stages: Stages) -> WorkBalance:
    """Balance work and mix of a cycle under the first law by the first criterion."""
    contacts, scene = stages.contacts, stages.contacts.scene
    machine, motion, product = scene.machine, scene.motion, scene.product
    run = stages.drive.runs[stages.drive.best_law]
    resistance = force_at(stages.resistance.resistance, scene.mean_speed)
    before, behind = scene.layer.fed_density_ratio, scene.mix.density_ratio
    if contacts.compacts:  # behind the first pass at the mean speed
        found = float(contacts.mean_record.exit_density_ratio or behind)
        behind = min(max(found, before), MEASURED_DENSITY_RATIO)
    carried = strokes = None
    speed = product.mould_speed or (scene.process and scene.process.mould_speed)
    if speed:
        advance = speed * (motion.duration + motion.dwell)
        carried, strokes = advance * product.width * product.height, machine.roller_length / advance
    volume = machine.rollers * machine.roller_length * scene.lift_thickness  # of product over the travel [m2]
    pressed, fresh = volume * motion.stroke, 2 if scene.layer.return_stroke == "fresh" else 1
    work = resistance / volume
    if contacts.process is not None:  # both strokes press what the mould carries away on the width of the rollers
        before, fresh = contacts.process.problem.feed.density_ratio, 2
        carried = pressed = contacts.process.product_volume
        work = resistance * (1 + stages.resistance.map.return_ratio) / 2 * motion.stroke / pressed
    confined, loose = (heckel_work(start, behind, contacts.mix.heckel_slope) for start in (before, LOOSE_DENSITY_RATIO))
    cycle_work = float(np.sum(run.weights * run.state.resistance * run.state.velocity))
    return WorkBalance(run.name, (before, behind), work, confined, loose, cycle_work, pressed, fresh, carried, strokes)


def heckel_work(before: float, behind: float, heckel_slope: float) -> float:
    """Compute the work of confined compression on Heckel's curve over the compacted volume [J/m3].

    `confined_floor.confined_work` is that by a constitutive law, with its rate and several entries.

        w = k int s_v(k') dk'/k'^2,   s_v = ln[(1 - k0)/(1 - k')]/K_H

    Parameters
    ----------
    before, behind : float
        Density ratios [-].
    heckel_slope : float
        K_H [1/Pa].

    Returns
    -------
    float
        Work over the compacted volume [J/m3].

    Examples
    --------
    >>> f"{heckel_work(0.936, 0.98, 14.4e-6) / 1e3:.2f} kJ/m3"
    '6.33 kJ/m3'
    """
    work, _ = quad(lambda k: np.log((1 - LOOSE_DENSITY_RATIO) / (1 - k)) / k**2, before, behind, epsrel=1e-10)
    return behind * work / heckel_slope


LINEAR_WORK_LIMIT = 1e-2  # [-], of the work of a contact with a linear layer
COMPACTED_WORK_LIMIT = 2e-2  # [-], of the work of a contact with a compacting layer
CYCLE_WORK_LIMIT = 1e-6  # [-], of the work of resistance and friction over a cycle
BREADTH_LIMIT = 1e-9  # [-], of the breadth of a cam
RESIDUALS = {  # field of a contact -> (term, limit [-]); compacting layers only
    "mass_residual": ("mass", 2e-3),
    "yield_residual": ("stress within the cap", 1e-2),
    "equilibrium_residual": ("equilibrium", 1e-2),
}


class BalanceCheck(NamedTuple):
    """Residual of one balance and its limit.

    Parameters
    ----------
    residual : float
        Relative residual, or a count [-].
    limit : float
        Largest admissible magnitude of the residual [-].
    """

    name: str
    residual: float
    limit: float

    @property
    def passed(self) -> bool:
        """True if the residual is within its limit."""
        return abs(self.residual) <= self.limit


def balance_checks(stages: Stages) -> list[BalanceCheck]:
    """Check every contact, run and cam of a scene.

    A contact has a balance of energy, that of a compacting layer also those of mass and forces and the yield condition.
    A cycle compares its energy with the work of resistance and guide friction.
    """
    checks, contacts = [], stages.contacts
    work_limit = COMPACTED_WORK_LIMIT if contacts.compacts else LINEAR_WORK_LIMIT
    limits = RESIDUALS | {"work_residual": ("work of the contact", work_limit)}
    for contact in contacts.records:
        for name, (term, limit) in limits.items():
            if (residual := getattr(contact, name)) is not None:
                checks.append(BalanceCheck(f"{term} at {contact.speed:.4g} m/s", residual, limit))
    for law, run in stages.drive.runs.items():
        if run.impulses:
            continue
        residual = getattr(run, "energy_residual", None)
        if residual is None:
            force = run.state.resistance + run.state.forces.guide_friction
            residual = float(np.sum(run.weights * force * run.state.velocity)) / run.energy - 1
        checks.append(BalanceCheck(f"work over a cycle, {law}", residual, CYCLE_WORK_LIMIT))
    if "cams" in contacts.scene.output.items:
        checks += [
            BalanceCheck(f"constant breadth of the cam, {law}", cam.breadth_error / cam.breadth, BREADTH_LIMIT)
            for (law, follower), cam in stages.laws.cams.items()
            if follower == "roller" and not cam.cycle.forward.retraces
        ]
    return checks
