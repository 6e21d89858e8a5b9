"""Resistance stage of a study: the resistance of the mix to one cart over its speed, and the cart itself.

The resistance of a layered engine is a `ResistanceMap`, sampled from the contacts of the scene and further ones. Where
the speed enters through the rate factor of the yield pressure alone, the map is the law `RateLaw` of these contacts.
The formulas have a dry resistance by eq 1.8. Where a motion law is faster than the map, the map is extended.

After a turn of the cart the resistance builds up along the stroke by the shares of the steady contact (`turning`). It
is a step, its value far from the turn at once, where the scene asks for it and where an engine compacts no mix.
"""

import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np

from compact import contact, resistance
from compact.analysis import machine_models
from compact.analysis.contact_cases import nearest_speed
from compact.analysis.pore_air import nodes_of_map
from compact.analysis.stages.contacts import ContactStage
from compact.contact import DryResistance
from compact.engines.pore_air import NO_FORCES
from compact.machine.cart import Balance, Cart, MotionResistance
from compact.machine.rigid_drive import steady_balance, stroke_shares
from compact.motion.profile import MotionProfile
from compact.numerics import Array
from compact.resistance import ForceSample, ResistanceMap
from compact.rolling_contact import Contact
from compact.scene.schema import Motion
from compact.turning import RELEASED, Share, StrokeResistance, elastic_release, table_share, with_standing_drag

if TYPE_CHECKING:
    from compact.engines.interface import Turning

ResistanceLaw = ResistanceMap | DryResistance | StrokeResistance | Callable[[Array, Array], Array]

SIDES = "forward", "return"
STROKE_SAMPLES, RELEASE_SAMPLES = 201, 25  # [-], of shares over a stroke, and over the release of the old force
LEAST_RELEASE = 1e-3  # [-], first of them over the whole release
CYCLE_SAMPLES = 401  # [-], times of a pass
LEAST_SPEED_SHARE = 1 / 50  # [-], of the largest speed; least speed of the samples


class ResistanceStage:
    """Resistance of the mix to one cart; each attribute is computed when first used.

    Parameters
    ----------
    largest_speed : callable
        Returns the largest speed of the cart under the laws of the scene [m/s]; called for layered engines only.
    given : callable, optional
        Resistance in place of that of the engine, without an error estimate.
    """

    def __init__(
        self, contacts: ContactStage, largest_speed: Callable[[], float], given: ResistanceLaw | None = None
    ) -> None:
        self.contacts, self.scene, self.mix = contacts, contacts.scene, contacts.mix
        self._largest_speed, self._given = largest_speed, given
        self._over: dict[float, ResistanceStage] = {}

    @cached_property
    def largest_speed(self) -> float:
        """Speed up to which the resistance is known [m/s]."""
        return self._largest_speed()

    @cached_property
    def map(self) -> ResistanceMap:
        """Resistance of one cart up to `largest_speed`, by a layered engine."""
        kept = self.contacts.kept.resistance_map if self.contacts.kept else None
        if kept and self.largest_speed <= kept.speeds[-1] * (1 + resistance.SPEED_ROUNDING):
            return kept
        return self.sampled_map(kept, self.largest_speed)

    @cached_property
    def resistance(self) -> ResistanceLaw:
        """Resistance of the mix to one cart [N], a function of velocity, acceleration and travel since the turn."""
        return self.along_stroke(self.steady_law)

    @property
    def steady_law(self) -> ResistanceLaw:
        """Resistance far from a turn [N], a function of velocity and acceleration."""
        if self._given is not None:
            return self._given
        if self.contacts.speeds:
            return self.map
        return contact.dry_resistance(self.scene.machine.rollers * self.contacts.engineering.roller_resistance)

    @cached_property
    def turning(self) -> "Turning | None":
        """Shares of force and load after a turn over the distance to fresh mix; None for a step."""
        turn = self.scene.drive.turn
        if turn == "step" or self._given is not None:
            return None
        if not isinstance(turn, str | None):
            return partial(_at_any_distance, table_share(*zip(*turn, strict=True)))
        with warnings.catch_warnings(action="ignore"):  # the shares need edges and exponent of the contact alone
            near = self.contacts.mean_record
        scene, mix = self.scene, self.contacts.mix
        lower, height = scene.layer.lower_lift, scene.lift_thickness
        film = height * scene.mix.density_ratio / scene.layer.fed_density_ratio if lower else None
        radius, modulus = scene.machine.roller_radius, mix.unloading_modulus / (1 - mix.poisson**2)
        below = lower.thickness if lower else 0.0
        release = elastic_release(radius, modulus, height + below, near.leading, near.peak_pressure)
        found = self.contacts.engine.turning(near, radius, release, film)
        drag = self.contacts.sleeve_drag
        if found is None or not drag:
            return found
        return partial(with_standing_drag, found, drag / float(self.map(scene.mean_speed)))

    @cached_property
    def mean_share(self) -> float:
        """Mean of the force over a cycle of position, over that far from the turns [-]; 1 for a step."""
        rows = sampled_shares(self.resistance, self.cart, self.scene.motion)
        means = [np.trapezoid(force, travel) / travel[-1] for _, travel, force, _ in rows]
        return float(np.mean(means))

    def over_cycle(self, profile: MotionProfile) -> tuple[Array, Array, Array]:
        """Sample a cycle under a law: position [m], resistance, and its value far from the turns [N].

        Parameters
        ----------
        profile : MotionProfile
            Law of the forward stroke, which the return stroke mirrors.
        """
        time = np.linspace(0, profile.duration, CYCLE_SAMPLES)
        travel, speed, acceleration = profile.position(time), profile.velocity(time), profile.acceleration(time)
        steady = np.concatenate([self.steady_law(way * speed, way * acceleration) for way in (1.0, -1.0)])
        known = stroke_shares(self.cart, profile.stroke, profile.duration, self.resistance)
        shares = np.concatenate([side.force_share(travel) for side in known]) if known else 1.0
        return np.concatenate([travel, profile.stroke - travel]), steady * shares, steady

    def along_stroke(self, steady: ResistanceLaw) -> ResistanceLaw:
        """Return another resistance far from the turn [N] with the shares after the turns of this stage."""
        return along_stroke(steady, self.turning, self.scene.sleeve_distances)

    @property
    def error(self) -> float | None:
        """Relative error estimate of the resistance [-], of the interpolation and the engine; None if unknown."""
        if self._given is not None or not self.contacts.speeds or self.map.engine_error is None:
            return None
        return self.map.error + self.map.engine_error

    def over(self, duration: float) -> "ResistanceStage":
        """Return the stage of another duration of a pass [s]; itself unless the forces depend on the duration."""
        if duration not in self._over:
            over = self.contacts.over(duration)
            other = ResistanceStage(over, lambda: self.largest_speed, self._given)
            self._over[duration] = self if over is self.contacts else other
        return self._over[duration]

    @cached_property
    def cart(self) -> Cart:
        """Cart with the reactions of its rollers."""
        return machine_models.cart(self.scene, self.contacts.roller_load, self.contacts.return_ratios[0])

    @cached_property
    def motion_resistance(self) -> MotionResistance:
        """All forces on a cart that moves along a straight path, but its inertia."""
        return MotionResistance(self.cart, self.resistance)

    @cached_property
    def steady(self) -> Balance:
        """Forces on the cart at constant mean speed, arrays of shape (1,)."""
        return steady_balance(self.cart, self.scene.mean_speed, self.resistance)

    def extend(self, speed: float) -> None:
        """Add samples to the map up to a speed [m/s]; existing samples remain."""
        self.map = self.sampled_map(self.map, speed)
        self.largest_speed = speed
        for stale in ("resistance", "motion_resistance"):
            self.__dict__.pop(stale, None)

    def sampled_map(self, known: ResistanceMap | None, speed: float) -> ResistanceMap:
        """Sample the resistance of one cart up to a speed.

        Parameters
        ----------
        known : ResistanceMap or None
            Map whose samples are used; those of the contacts by default.
        speed : float
            Largest speed [m/s].
        """
        stage = self.contacts
        samples = [self._sample(*each) for each in self._rolled] if known is None else list(known.computed)
        least = min(LEAST_SPEED_SHARE * speed, min(each.speed for each in samples))
        tolerance = self.scene.accuracy.tolerance
        sampled = stage.engine.sample(self._new_sample, stage.rate_factor, least, speed, tolerance, samples)
        if stage.has_air:  # the contacts of the map remain those without
            speeds = nodes_of_map(sampled.speeds)
            air = [(stage.air_forces(each) or NO_FORCES).resistance for each in speeds.tolist()]
            forces = sampled(speeds) + self._roller_length * np.array(air)
            sampled = replace(sampled, speeds=speeds, forces=forces, contacts=sampled.computed)
        # sleeves drag in both directions
        share = stage.sleeve_drag / float(sampled(self.scene.mean_speed)) if stage.sleeve_drag else 0.0
        return self._with_added_masses(replace(sampled, return_ratio=stage.return_ratios[1] * (1 - share) + share))

    @property
    def _roller_length(self) -> float:
        """Length of all rollers of a cart [m]."""
        return self.scene.machine.rollers * self.scene.machine.roller_length

    @cached_property
    def _rolled(self) -> list[tuple[float, Contact]]:
        """Speed [m/s] and contact of each first pass that has been computed."""
        stage = self.contacts
        if stage.kept:
            return []
        reference = stage.__dict__.get("reference")
        return stage.engine.first_samples(stage.first_passes, reference and (self.scene.mean_speed, reference[0]))

    def _new_sample(self, speed: float) -> ForceSample:
        """Compute a contact at a speed [m/s], from the nearest one as initial guess."""
        stage, rolled = self.contacts, self._rolled
        stage.count("resistance")
        guess = rolled[nearest_speed((each for each, _ in rolled), speed)][1] if rolled else None
        result = stage.first_pass(speed, guess)
        rolled.append((speed, result))
        return self._sample(speed, result)

    def _sample(self, speed: float, result: Contact) -> ForceSample:
        drag, force, error = self.contacts.sleeve_drag, self._roller_length * result.resistance, result.resistance_error
        if drag and error is not None:
            error *= force / (force + drag)
        return ForceSample(speed, force + drag, error, self.contacts.engine.noise(result))

    def _with_added_masses(self, sampled: ResistanceMap) -> ResistanceMap:
        """Return the map with the added mass at its speeds; without it where the engine does not find it."""
        stage = self.contacts
        try:
            found = [stage.added_mass(float(at)) for at in sampled.speeds]
        except RuntimeError as error:
            warnings.warn(f"acceleration is left out of the resistance: {error}", stacklevel=2)
            return sampled
        masses, times = np.array(found).T
        return replace(sampled, added_masses=self._roller_length * masses, relaxation_time=float(times.max()))


def force_at(law: ResistanceLaw, speed: float) -> float:
    """Return the resistance of one cart at a steady speed [m/s], far from a turn [N]."""
    return float(np.ravel(law(np.array([speed]), np.zeros(1)))[0])


def along_stroke(steady: ResistanceLaw, turning: "Turning | None", distances: tuple[float, float]) -> ResistanceLaw:
    """Return a resistance that builds up after the turns of the cart; the same one for a step.

    Parameters
    ----------
    steady : callable
        Resistance far from a turn [N].
    turning : callable or None
        Shares of force and load over the distance to fresh mix.
    distances : tuple of float
        That distance at the near end, from which the forward stroke starts, and at the far end [m].
    """
    if turning is None:
        return steady
    forces, loads = zip(*map(turning, distances), strict=True)
    return StrokeResistance(steady, *forces, *loads)


def sampled_shares(law: ResistanceLaw, cart: Cart, motion: Motion) -> list[tuple[str, Array, Array, Array]]:
    """Sample the shares of a resistance over a full stroke of a periodic motion.

    Returns
    -------
    list of tuple
        Side, "forward" or "return", travels since the turn [m], shares of force and load there [-]; 1 for a step.
    """
    stroke, found = motion.stroke, []
    known = stroke_shares(cart, stroke, motion.duration, law)
    if known is None:
        return [(side, np.array([0.0, stroke]), np.ones(2), np.ones(2)) for side in SIDES]
    for side, shares in zip(SIDES, known, strict=True):
        near = np.geomspace(LEAST_RELEASE, 1.0, RELEASE_SAMPLES) * min(RELEASED * shares.force.release, stroke)
        kinks = [travel for travel in shares.travels if travel < stroke]
        travel = np.sort([*near, *kinks, *np.linspace(0, stroke, STROKE_SAMPLES)])
        found.append((side, travel, shares.force_share(travel), shares.load_share(travel)))
    return found


def _at_any_distance(share: Share, _: float) -> tuple[Share, Share]:
    """Return one share of force and load that does not depend on the distance to fresh mix."""
    return share, share
