"""Random scenes of steady rolling, and how far the error that an engine tells is from its true one."""

import numpy as np

from compact.material import Viscoelastic
from compact.records import Layer, Roller

HEIGHT, SPEED = 0.22, 1.0


def random_scenes(count):
    """(layer, roller, material, what is to be prescribed): half-widths a of 0.05 to 3 heights and 0.02 to 0.4 radii,
    nu 0.2 to 0.49, both bases, parabola and circle, frictionless and sliding, up to three branches of v tau/a 1e-4 to
    1e4 with shares of 0.2 to 5.
    """
    draw = np.random.default_rng(2015)
    for _ in range(count):
        a = HEIGHT * 10 ** draw.uniform(np.log10(0.05), np.log10(3))
        radius = a / 10 ** draw.uniform(np.log10(0.02), np.log10(0.4))
        branches = tuple(
            (10 ** draw.uniform(-0.7, 0.7), a / SPEED * 10 ** draw.uniform(-4, 4)) for _ in range(draw.integers(4))
        )
        mix = Viscoelastic(1e7, draw.uniform(0.2, 0.49), branches)
        roller = Roller(
            radius,
            indentation=a**2 / radius * (0.5 + 0.5 * np.log1p(0.66 * HEIGHT / a)),
            friction=draw.uniform(0.05, 1) * draw.integers(2),
            rolling="sliding",
            profile=str(draw.choice(["parabola", "circle"])),
        )
        layer = Layer(HEIGHT, str(draw.choice(["bonded", "slip"])))
        yield layer, roller, mix, str(draw.choice(["indentation", "load", "peak_pressure"]))


def prescribing(roller, name, value):
    """The roller with another target."""
    return Roller(
        roller.radius, friction=roller.friction, rolling=roller.rolling, profile=roller.profile, **{name: float(value)}
    )


def true_errors(rolled, roller, judge):
    """Relative errors of load and resistance by judge(roller); of a load that is prescribed, at the depth found."""
    exact = judge(roller)
    as_deep = exact if roller.load is None else judge(prescribing(roller, "indentation", rolled.indentation))
    scale = max(abs(exact.resistance), 1e-3 * exact.load)
    return abs(rolled.load / as_deep.load - 1), abs(rolled.resistance - exact.resistance) / scale


def told_over_true(told, true, rounding):
    """Smallest, median and 95 % quantile of the ratio where there is more than rounding; what is told of the rest."""
    told, true = np.array(told), np.array(true)
    clear = true > rounding
    smallest, median, large = np.quantile(told[clear] / true[clear], [0, 0.5, 0.95])
    return smallest, median, large, np.max(told, where=~clear, initial=0)
