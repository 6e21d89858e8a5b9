"""Random scenes of steady rolling, and the ratio of estimated to true errors."""

from dataclasses import replace
from functools import partial

import numpy as np

from compact import fem
from compact.engines.spectral import engine as spectral
from compact.engines.spectral.engine import contact_of_half_width
from compact.material.laws import Elastic, Viscoelastic
from compact.rolling_contact import Layer, Roller

R, HEIGHT, SPEED = 0.11, 0.22, 1.0
LAYER = Layer(HEIGHT)
MIX = Elastic(youngs_modulus=10e6, poisson=0.3)
SLS = Viscoelastic(youngs_modulus=10e6, poisson=0.3, branches=((1.0, 1.0),))  # v tau is v


def roll_elements(*case, **numerics):
    """Contact by finite elements without the error estimate from another mesh."""
    return fem.roll(*case, estimate=False, **numerics)


def random_scenes(count):
    """Yield (layer, roller, material, name of the target).

    Half-widths a of 0.05 to 3 heights and 0.02 to 0.4 radii, nu 0.2 to 0.49, both bases, parabola and circle,
    frictionless and sliding, up to three branches of v tau/a 1e-4 to 1e4 with shares of 0.2 to 5.
    """
    draw = np.random.default_rng(2015)
    for _ in range(count):
        a = HEIGHT * 10 ** draw.uniform(np.log10(0.05), np.log10(3))
        radius = a / 10 ** draw.uniform(np.log10(0.02), np.log10(0.4))
        branches = tuple(
            (10 ** draw.uniform(-0.7, 0.7), a / SPEED * 10 ** draw.uniform(-4, 4)) for _ in range(draw.integers(4))
        )
        mix = Viscoelastic(youngs_modulus=1e7, poisson=draw.uniform(0.2, 0.49), branches=branches)
        roller = Roller(
            radius,
            indentation=a**2 / radius * (0.5 + 0.5 * np.log1p(0.66 * HEIGHT / a)),
            friction=draw.uniform(0.05, 1) * draw.integers(2),
            rolling="sliding",
            profile=str(draw.choice(["parabola", "circle"])),
        )
        layer = Layer(HEIGHT, base=str(draw.choice(["bonded", "slip"])))
        yield layer, roller, mix, str(draw.choice(["indentation", "load", "peak_pressure"]))


def stiff_scene(seed, number):
    """Return one (layer, roller, material, speed).

    Half-widths of 0.05 to 5 heights and 0.02 to 0.35 radii, nu 0.05 to 0.495, one to three branches with an
    instantaneous modulus up to 100 times the relaxed one, v tau/a over six decades, every profile, rolling, base and
    target, friction to 0.8, both directions.
    """
    draw = np.random.default_rng((seed, number))
    a = HEIGHT * 10 ** draw.uniform(np.log10(0.05), np.log10(5))
    radius = a / 10 ** draw.uniform(np.log10(0.02), np.log10(0.35))
    count, speed = int(draw.integers(1, 4)), 10 ** draw.uniform(-3, 3)
    shares = draw.dirichlet(np.ones(count)) * (10 ** draw.uniform(0, 2) - 1)
    times = a / speed * 10 ** draw.uniform(-3, 3, count)
    branches = tuple((float(share), float(time)) for share, time in zip(shares, times, strict=True))
    mix = Viscoelastic(youngs_modulus=1e7, poisson=draw.uniform(0.05, 0.495), branches=branches)
    layer = Layer(HEIGHT, base=str(draw.choice(["bonded", "slip"])))
    rolling = str(draw.choice(["frictionless", "sliding", "free", "driven"]))
    friction = draw.uniform(0.02, 0.8) * (rolling != "frictionless")
    roller = Roller(
        radius,
        indentation=contact_of_half_width(layer, mix, radius, a).indentation,
        friction=friction,
        rolling=rolling,
        profile=str(draw.choice(["parabola", "circle", "deformed"])),
    )
    name, speed = str(draw.choice(["indentation", "load", "peak_pressure"])), speed * draw.choice([1, -1])
    smooth = rolling if rolling == "sliding" else "frictionless"
    vertical = "parabola" if roller.profile == "deformed" else roller.profile
    rolled = spectral.roll(layer, replace(roller, rolling=smooth, profile=vertical), mix, speed)
    return layer, prescribing(roller, name, getattr(rolled, name)), mix, float(speed)


def prescribing(roller, name, value):
    """Return the roller with another target."""
    return Roller(
        roller.radius, friction=roller.friction, rolling=roller.rolling, profile=roller.profile, **{name: float(value)}
    )


def true_errors(rolled, roller, reference):
    """Relative errors of load and resistance by reference(roller); of a prescribed load, at the indentation found."""
    exact = reference(roller)
    at_depth = exact if roller.load is None else reference(prescribing(roller, "indentation", rolled.indentation))
    scale = max(abs(exact.resistance), 1e-3 * exact.load)
    return abs(rolled.load / at_depth.load - 1), abs(rolled.resistance - exact.resistance) / scale


def assert_estimates(scenes, roll, reference, rounding, rest):
    """Half the true error or more, five times it in the median, twenty in 95 %; below `rest` where it is rounding.

    True errors are those of `roll(layer, roller, mix, speed)` from `reference(layer, mix, rolled, roller)`.
    """
    estimated, true = [], []
    for layer, roller, mix, name in list(random_scenes(60))[scenes]:
        given = prescribing(roller, name, getattr(spectral.roll(layer, roller, mix, SPEED), name))
        rolled = roll(layer, given, mix, SPEED)
        estimated.append(rolled.error)
        true.append(true_errors(rolled, given, partial(reference, layer, mix, rolled)))
    for told, errors in zip(np.transpose(estimated), np.transpose(true), strict=True):
        clear = errors > rounding
        smallest, median, large = np.quantile(told[clear] / errors[clear], [0, 0.5, 0.95])
        assert (smallest >= 0.5, median <= 5, large <= 20) == (True, True, True), (smallest, median, large)
        assert np.max(told, where=~clear, initial=0) < rest
