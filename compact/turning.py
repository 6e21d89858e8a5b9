"""Resistance along the stroke: the share of the steady force and load after a turn of the motion.

    R = F(v, a) g(s),   g = f(s) - (g_end + f(0)) exp(-s/r)

s is the travel since the last turn. Just after a turn the mix still pushes with its old force, now along the motion,
and lets go within the release r; g_end is g where the last stroke ended. The roller then runs on its own track until it
meets fresh mix, d ahead. f is a `Share`; R is continuous through a turn. The load does not change its sign:

    g = f(s) + (g_end - f(0)) exp(-s/r)

Each heading remembers its front, the place up to which its mix is rolled, and the origin of its travel. A roller that
turned in mid-stroke runs on its own track up to the old front, which it loads like a spring, mirror of the release:

    f = track + (f(front) - track) exp(-(front - x)/r)   short of the front, f(|x - origin|) beyond

A roller that moved away from the front by more than d has fresh mix d ahead and its origin at the turn.

A resistance without these shares has its steady value from the turn on: a step.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.special import betainc, betaincinv

from compact.numerics import Array
from compact.numerics.validation import as_numbers, require_between, require_nonnegative, require_positive

# all by reciprocating runs of the compacting engine with friction 0.35, `studies/reversal.py`
TRACK, LOAD_TRACK = 0.02, 0.25  # [-], share of force and load on the own track: a second pass over the same mix
RELEASE_HALF_PLANE, RELEASE_LAYER = 0.5, 1.25  # [-], of the stiffnesses E'/l and E'/H that lift the mix after a turn
CLIMB = 2.0  # [-], share over contact lengths in fresh mix, until the first front stands
WAVE_LENGTH, WAVE_EXPONENT = 5.0, 0.75  # [-], build-up of the bow wave: 5 (bow wave/depth)^0.75 contact lengths
LOAD_WAVE_LENGTH = 0.8  # [-], likewise for the load, over that for the force
# of a film, fresh mix thinner than the contact is long, likewise: least squares of make-ups of 1 and 4 mm
FILM = 5.2  # [-], contact lengths over thicknesses; beyond, the wave builds up faster
FILM_CLIMB = 0.77  # [-], contact lengths, until the first front of a film stands
FILM_POWER, FILM_LOAD_POWER = 2.4, 1.5  # [-], of its imprint in force and load
COMPLETE = 1e-12  # [-], of a share; the build-up ends there
RELEASED = 36.0  # [-], releases after which the old force is rounding


@dataclass(frozen=True)
class Share:
    """Share of the steady force, or load, over the travel since the last turn; call it with travels [m] of any shape.

    Parameters
    ----------
    function : callable
        Share [-], in [0, 1], over the travel [m].
    track : float
        Share on the own track [-].
    travels : tuple of float
        Travels [m] at which it is not smooth, ascending; constant beyond the last.
    distance : float
        Travel d on the own track before fresh mix is met [m].
    release : float
        Length r over which the old force lets go [m]; 0 at once.
    standing : float
        Part of the force that does not build up after a turn, the drag of sleeves and plate [-].
    """

    function: Callable[[Array], Array]
    track: float
    travels: tuple[float, ...]
    distance: float = 0.0
    release: float = 0.0
    standing: float = 0.0

    def __call__(self, travel: ArrayLike) -> Array:
        """Return f [-] at travels since the turn [m]."""
        return self.standing + (1 - self.standing) * self.function(np.asarray(travel, float))


@dataclass(frozen=True)
class _Wave:
    """Share of a contact that climbs onto fresh mix and builds up its bow wave."""

    length: float
    distance: float
    part: float  # of the wave in the steady force
    build_up: float  # length over contact lengths
    track: float
    film: float  # 0 of a layer, 1 of a film
    power: float  # of the imprint of a film

    def __call__(self, travel: Array) -> Array:
        x = np.maximum(travel - self.distance, 0.0) / self.length
        missing = self.part * np.exp((self.top - np.maximum(x, self.top)) / self.build_up) if self.part else 0.0
        missing = np.where(missing > COMPLETE, missing, 0.0)
        return np.maximum(self.track, self.rise(x) * (1 - missing))

    @property
    def top(self) -> float:
        """Contact lengths in fresh mix to the top of the first front."""
        return (1 - self.film) / CLIMB + self.film * FILM_CLIMB

    def rise(self, x: Array) -> Array:
        """Share of the first front over contact lengths in fresh mix."""
        u = np.minimum(x / FILM_CLIMB, 1.0)
        return (1 - self.film) * np.minimum(CLIMB * x, 1.0) + self.film * (2 * u - u**2) ** self.power

    def travels(self) -> tuple[float, ...]:
        top = complete = self.top
        first = float(self.rise(np.array(top))) * (1 - self.part)
        if first > self.track:
            onset = brentq(lambda x: float(self.rise(np.array(x))) * (1 - self.part) - self.track, 0.0, top, xtol=1e-15)
        else:  # the first front stands below the track
            onset = top + self.build_up * math.log(self.part / (1 - self.track))
        if self.part > COMPLETE:
            complete += self.build_up * math.log(self.part / COMPLETE)
        kinks = {1 / CLIMB} if self.film < 1 else set()
        places = np.array(sorted({onset, top, complete, *kinks, *({FILM_CLIMB} if self.film else ())}))
        return tuple(np.unique(self.distance + self.length * places[places >= onset]).tolist())


@dataclass(frozen=True)
class _Imprint:
    """Share of a contact of a circle that grows into fresh mix, of pressure ~ depth^(power - 1)."""

    length: float
    edge: float
    power: float
    track: float
    of_load: bool  # the integral of the pressure along the contact

    def __call__(self, travel: Array) -> Array:
        left = (1 - np.clip((travel - self.edge) / self.length + 1, 0.0, 1.0)) ** 2
        share = 1 - betainc(0.5, self.power, left) if self.of_load else (1 - left) ** self.power
        return np.maximum(self.track, share)

    def travels(self) -> tuple[float, ...]:
        track = self.track
        left = betaincinv(0.5, self.power, 1 - track) if self.of_load else 1 - track ** (1 / self.power)
        onset = max(self.edge - self.length * math.sqrt(left), 0.0)
        return tuple(sorted({onset, self.edge}))


@dataclass(frozen=True)
class _Table:
    """Share of a table, linear between its rows."""

    travel: tuple[float, ...]
    share: tuple[float, ...]

    def __call__(self, travel: Array) -> Array:
        return np.interp(travel, self.travel, self.share)


def elastic_release(radius: float, modulus: float, height: float, leading: float, peak_pressure: float) -> float:
    """Return the length over which the old force lets go after a turn [m].

        r = p R/(E' (1/2 + 1.25 l/H)),   E' = E/(1 - nu^2)

    A travel s lifts the arc of the roller off the mix by s x/R at the distance x ahead of its axle, and the mix follows
    it with the stiffness of an elastic half-plane, about E'/l, and of a layer on a rigid base, about E'/H.

    Parameters
    ----------
    radius : float
        R of the roller [m], > 0.
    modulus : float
        E' of unloading in plane strain [Pa], > 0.
    height : float
        H of all mix between roller and base [m], > 0.
    leading : float
        Front l of the contact ahead of the axle [m], >= 0.
    peak_pressure : float
        p [Pa], >= 0.

    Notes
    -----
    Fitted to releases of `simulate_reciprocating` in 5 of 9 cases, of E' of 132 MPa and l/H of 0.26 to 0.79; the others
    are met within 15 %.

    Examples
    --------
    >>> f"{1e3 * elastic_release(0.11, 132e6, 0.063, 0.042, 266e3):.2f} mm"
    '0.17 mm'
    """
    require_positive(radius=radius, modulus=modulus, height=height)
    require_nonnegative(leading=leading, peak_pressure=peak_pressure)
    return peak_pressure * radius / (modulus * (RELEASE_HALF_PLANE + RELEASE_LAYER * leading / height))


def wave_shares(
    contact_length: float,
    depth: float,
    bow_wave: float,
    release: float,
    edge_distance: float,
    thickness: float | None = None,
) -> tuple[Share, Share]:
    """Shares of the force and of the load of a compacting contact that builds up its bow wave after a turn.

        x = (s - d)/a,   f = max(track, min(1, 2 x) [1 - B exp(-max(0, x - 0.5)/lambda)])
        B = w/(depth + w),   lambda = 5 (w/depth)^0.75

    A film, t < a/5.2, as a make-up of loose mix on a dense lift, yields like an imprint and soon has its wave:

        f = max(track, (2 u - u^2)^2.4 [1 - B exp(-max(0, x - 0.77)/lambda)]),   u = min(1, x/0.77)
        lambda (5.2 t/a)^0.75

    Between a/t of 1 and 5.2 both are mixed in proportion. For the load

        1 - B = sqrt(depth/(depth + w)),   lambda = 0.8 of that of the force,   a quarter on the own track;
        (2 u - u^2)^1.5 on a film

    Parameters
    ----------
    contact_length : float
        a = sqrt(2 R depth) [m], > 0.
    depth : float
        Depth below the undisturbed surface [m], > 0.
    bow_wave : float
        Height w of the steady bow wave [m], >= 0.
    release : float
        Length r over which the old force lets go [m], >= 0; see `elastic_release`.
    edge_distance : float
        D [m] from the axle back to the edge of fresh mix at the turn; d = max(0, D - a).
    thickness : float
        t of the fresh mix on a dense lift [m], > 0; without one it is a thick layer.

    Notes
    -----
    Fitted to histories of force of `simulate_reciprocating` for bow waves of 0.25 to 1.9 depths; others, of 0.7 to 2.5
    depths, are met within 0.1 in the climb, 0.03 in the mean square; films of 1 to 4 mm within 0.05 in the mean square.

    Examples
    --------
    >>> share, _ = wave_shares(0.026, depth=2.1e-3, bow_wave=2.54e-3, release=0.2e-3, edge_distance=0.110)
    >>> print(*(f"{share(travel):.2f}" for travel in (0.05, 0.0972, 0.105, 0.2, 0.5)))
    0.02 0.45 0.48 0.72 0.96
    """
    require_positive(contact_length=contact_length, depth=depth, thickness=1.0 if thickness is None else thickness)
    require_nonnegative(bow_wave=bow_wave, release=release, edge_distance=edge_distance)
    length, ratio, slenderness = contact_length, bow_wave / depth, contact_length / (thickness or math.inf)
    film, beyond = min(max((slenderness - 1) / (FILM - 1), 0.0), 1.0), max(slenderness / FILM, 1.0)
    stretch = WAVE_LENGTH * (ratio / beyond) ** WAVE_EXPONENT
    distance = max(0.0, edge_distance - length)

    def share(exponent: float, power: float, track: float, build_up: float) -> Share:
        part = -math.expm1(-exponent * math.log1p(ratio))  # 1 - (depth/(depth + w))^exponent
        wave = _Wave(length, distance, part, build_up, track, film, power)
        return Share(wave, track, wave.travels(), distance, release)

    force = share(1.0, FILM_POWER, TRACK, stretch)
    return force, share(0.5, FILM_LOAD_POWER, LOAD_TRACK, LOAD_WAVE_LENGTH * stretch)


def with_standing_drag(
    shares: Callable[[float], tuple[Share, Share]], part: float, edge_distance: float
) -> tuple[Share, Share]:
    """Shares of force and load, of which a part of the force does not build up after a turn, as of sleeves and plate.

        f = part + (1 - part) f_mix

    Parameters
    ----------
    shares : callable
        Shares of the mix over the distance to its fresh edge [m].
    part : float
        Part of the drag in the steady force [-], in [0, 1].
    edge_distance : float
        Distance [m].
    """
    require_between(0, 1, part=part)
    force, load = shares(edge_distance)
    return replace(force, standing=part, track=part + (1 - part) * force.track), load


def imprint_shares(contact_length: float, exponent: float, release: float, edge_distance: float) -> tuple[Share, Share]:
    """Shares of force and load of a contact without bow wave, which grows into fresh mix as its own imprint.

        force   f = max(track, (2 u - u^2)^(n + 1)),   u = (s - D)/a + 1,   p ~ depth^n
        load    f = max(track, int_(1-u)^1 (1 - x^2)^n dx / int_0^1 (1 - x^2)^n dx),   a quarter on the own track

    Parameters
    ----------
    contact_length : float
        a = sqrt(2 R depth) [m], > 0.
    exponent : float
        n of the pressure over the depth [-], >= 0.
    release : float
        Length over which the old force lets go [m], >= 0; see `elastic_release`.
    edge_distance : float
        D [m] from the axle back to the edge of fresh mix at the turn, >= 0; the contact is complete at s = D.

    Examples
    --------
    >>> share, _ = imprint_shares(contact_length=0.04, exponent=1.0, release=0.2e-3, edge_distance=0.110)
    >>> print(*(f"{share(travel):.4f}" for travel in (0.05, 0.09, 0.110)))
    0.0200 0.5625 1.0000
    """
    require_positive(contact_length=contact_length)
    require_nonnegative(exponent=exponent, release=release, edge_distance=edge_distance)
    force, load = (
        _Imprint(contact_length, edge_distance, exponent + 1, track, of_load)
        for track, of_load in ((TRACK, False), (LOAD_TRACK, True))
    )
    lengths = max(0.0, edge_distance - contact_length), release
    return Share(force, TRACK, force.travels(), *lengths), Share(load, LOAD_TRACK, load.travels(), *lengths)


def table_share(
    travel: ArrayLike, share: ArrayLike, *, track: float | None = None, distance: float = 0.0, release: float = 0.0
) -> Share:
    """Share of a table over the travel since the turn, linear between its rows and constant beyond.

    Parameters
    ----------
    travel, share : array_like, shape (n,)
        Travels [m], >= 0, ascending, and shares there [-], in [0, 1].
    track : float, optional
        Share on the own track, for a roller that turned in mid-stroke; that of the first row by default.
    distance, release : float
        d and r [m]; 0 by default: it restarts with its first row at each turn.

    Returns
    -------
    Share

    Examples
    --------
    >>> share = table_share((0.0, 0.110, 0.136), (0.0, 0.0, 1.0))
    >>> print(*share([0.1, 0.11, 0.2]))
    0.0 0.0 1.0
    """
    columns = [np.asarray(as_numbers(name, each), float) for name, each in (("travel", travel), ("share", share))]
    if {each.ndim for each in columns} != {1} or len({each.size for each in columns}) != 1 or not columns[0].size:
        raise ValueError(f"`travel` and `share` must be columns of one length, got {travel!r} and {share!r}")
    require_nonnegative(travel=columns[0], distance=distance, release=release)
    require_between(0, 1, share=columns[1], track=columns[1][0] if track is None else track)
    if not np.all(np.diff(columns[0]) > 0):
        raise ValueError(f"`travel` must ascend, got {columns[0].tolist()}")
    travels, shares = (tuple(each.tolist()) for each in columns)
    return Share(_Table(travels, shares), shares[0] if track is None else track, travels, distance, release)


class StrokeShares(NamedTuple):
    """Shares over a full stroke of a periodic motion, in one heading.

    Parameters
    ----------
    force, load : Share
    force_release, load_release : float
        Amounts g_end + f(0), and f(0) - g_end of the load, that the release takes from the shares at the turn [-].
    """

    force: Share
    load: Share
    force_release: float
    load_release: float

    def force_share(self, travel: ArrayLike) -> Array:
        """Return g of the force [-] at travels since the turn [m]."""
        return self.force(travel) - self.force_release * _decay(travel, self.force.release)

    def load_share(self, travel: ArrayLike) -> Array:
        """Return g of the load [-] at travels since the turn [m]."""
        return self.load(travel) - self.load_release * _decay(travel, self.load.release)

    @property
    def travels(self) -> tuple[float, ...]:
        """Travels at which a share is not smooth, or its release has ended [m], ascending."""
        ends = [RELEASED * share.release for share in (self.force, self.load) if share.release]
        return tuple(sorted({*self.force.travels, *self.load.travels, *ends}))


@dataclass(frozen=True)
class StrokeResistance:
    """Resistance that depends on the travel since the last turn of the motion: a force times a share.

    Parameters
    ----------
    resistance : callable
        F far from the turn [N] of velocity [m/s] and acceleration [m/s^2].
    forward, backward : Share
        Share of the force for velocities > 0 and < 0.
    forward_load, backward_load : Share
        Share of the roller reactions likewise; distance and release are those of the force.

    Examples
    --------
    >>> share = table_share((0.0, 0.05), (0.0, 1.0))
    >>> resistance = StrokeResistance(lambda v, a: 3486.0 * np.sign(v), share, share, share, share)
    >>> print(*(f"{resistance(-0.2, 0.0, travel):.0f}" for travel in (0.01, 0.1)), resistance(0.2, 0.0))
    -697 -3486 3486.0
    """

    resistance: Any
    forward: Share
    backward: Share
    forward_load: Share
    backward_load: Share

    def __post_init__(self) -> None:
        for force, load in ((self.forward, self.forward_load), (self.backward, self.backward_load)):
            if (force.distance, force.release) != (load.distance, load.release):
                raise ValueError(
                    "`distance` and `release` of the shares of force and load must agree, got "
                    f"{(force.distance, force.release)} and {(load.distance, load.release)} m"
                )

    def __call__(self, velocity: ArrayLike, acceleration: ArrayLike = 0.0, travel: ArrayLike | None = None) -> Array:
        """Return F f(travel) [N], after the release; F far from the turn without a travel since it [m]."""
        force = self.resistance(velocity, acceleration)
        if travel is None:
            return force
        return force * np.where(np.asarray(velocity) < 0, self.backward(travel), self.forward(travel))

    speeds = property(lambda self: getattr(self.resistance, "speeds", ()), doc="Sampled speeds [m/s].")
    odd = property(lambda self: getattr(self.resistance, "odd", False), doc="True if F is odd by construction.")

    def scaled(self, factor: float) -> "StrokeResistance":
        """Return the resistance times a factor [-]."""
        return replace(self, resistance=self.resistance.scaled(factor))

    def force_ratio(self, speed: float) -> float:
        """Return |F| backward over forward [-] at a speed [m/s]; 1 where either vanishes."""
        forward, backward = self.resistance(np.array([speed, -speed]), np.zeros(2)).tolist()
        return -backward / forward if forward and backward else 1.0

    def over(
        self, stroke: float, force_ratio: float = 1.0, load_ratio: float = 1.0
    ) -> tuple[StrokeShares, StrokeShares]:
        """Return the shares of forward and return stroke of a periodic motion over a full stroke [m].

        Parameters
        ----------
        stroke : float
            Stroke [m], > 0.
        force_ratio, load_ratio : float
            Steady force at rest, and load, backward over forward [-]; force and load are continuous at a turn.

        Returns
        -------
        tuple of StrokeShares
        """
        require_positive(stroke=stroke)
        forces, loads = (self.forward, self.backward), (self.forward_load, self.backward_load)
        amounts = _releases(forces, stroke, force_ratio or 1.0), _releases(loads, stroke, -(load_ratio or 1.0))
        releases = zip(*amounts, strict=True)
        forward, backward = (
            StrokeShares(*each) for each in zip(forces, loads, *zip(*releases, strict=True), strict=True)
        )
        return forward, backward


def _releases(shares: tuple[Share, Share], stroke: float, ratio: float) -> tuple[float, float]:
    """Amounts c of the release in both headings [-], by the ratio of the backward heading, negative for the load.

    g_end = f(h) - c exp(-h/r),   forward c = f(0) + ratio g_end backward,   backward c = f(0) + g_end forward/ratio
    """
    decays = [float(_decay(stroke, share.release)) for share in shares]
    starts, ends = [float(share(0.0)) for share in shares], [float(share(stroke)) for share in shares]
    amounts = np.linalg.solve(
        [[1.0, ratio * decays[1]], [decays[0] / ratio, 1.0]],
        [starts[0] + ratio * ends[1], starts[1] + ends[0] / ratio],
    )  # fmt: skip
    forward, backward = (a if share.release else 0.0 for a, share in zip(amounts.tolist(), shares, strict=True))
    return forward, backward


def _decay(travel: ArrayLike, release: float) -> Array:
    """Remainder exp(-s/r) of the old force [-] at travels [m]; 0 without a release."""
    return np.exp(-np.asarray(travel, float) / release) if release else np.zeros(np.shape(travel))
