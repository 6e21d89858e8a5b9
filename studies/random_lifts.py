"""Random lifts of rolling compaction: steady, heaps up, or not decided, each with its numbers.

Moisture 8 to 12 %, exit density ratio 0.92 to 0.985, roller radius 0.08 to 0.2 m, height 40 to 80 mm, depth 1 to 6 % of
it, friction up to 0.45, and the prior's mix; rollers without friction, free, sliding and driven. Seed 2026 has 60 lifts
with the elliptic cap, seed 2027 has 30 with the shear line.

`--constant` changes a constant of the search for the steady state, to see what depends on it.

    python studies/random_lifts.py [--seed 2026] [--increments 7] [--constant SETTLING=3] [numbers ...]
"""

import argparse
import time
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from compact.engines.compaction import steady_search
from compact.engines.compaction.engine import roll
from compact.engines.compaction.rolling_case import INCREMENTS
from compact.material.laws import Compaction, drucker_prager_cap
from compact.material.mix import LOOSE_DENSITY_RATIO, prior
from compact.rolling_contact import HeapingError, Layer, Roller, UnsteadyError

COUNTS = {2026: 60, 2027: 30}  # [-], lifts of a seed; the second one has the shear line
SPEED = 0.13  # [m/s]
PRESSURE = 200e3  # [Pa], at which Jaky's earth pressure coefficient holds


class Lift(NamedTuple):
    """Arguments of `roll`."""

    layer: Layer
    roller: Roller
    material: Compaction
    torque: float | None


def random_lift(seed: int, number: int) -> Lift:
    """Return one lift of a seed."""
    draw = np.random.default_rng((seed, number))
    moisture, k, radius = draw.uniform(0.08, 0.12), draw.uniform(0.92, 0.985), draw.uniform(0.08, 0.2)
    height = draw.uniform(0.04, 0.08)
    depth, friction = height * draw.uniform(0.01, 0.06), draw.uniform(0, 0.45)
    rolling = str(draw.choice(["frictionless", "free", "free", "sliding", "driven"]))
    share = draw.uniform(0, 0.5)
    mix = prior(moisture, k, {"rate_sensitivity": 0.0})
    strength = float(mix.cohesion / np.tan(np.radians(mix.friction_angle)))
    common = {
        "unloading_modulus": mix.unloading_modulus,
        "poisson": mix.poisson,
        "heckel_slope": mix.heckel_slope,
        "loose_density_ratio": LOOSE_DENSITY_RATIO,
        "fed_density_ratio": k / (1 + depth / height),
    }
    if seed == 2027:
        material: Compaction = drucker_prager_cap(
            friction_angle=mix.friction_angle,
            cohesion=mix.cohesion,
            earth_pressure_coefficient=1 - np.sin(np.radians(mix.friction_angle)),
            pressure=PRESSURE,
            shear_viscosity=mix.shear_viscosity,
            **common,
        )
    else:
        slope = float(np.sqrt(3) * np.sin(np.radians(mix.friction_angle)))
        material = Compaction(critical_slope=slope, tensile_strength=strength, heckel_test="confined", **common)
    sticks = rolling in ("free", "driven")
    if rolling == "sliding":
        friction *= 0.7
    if rolling == "frictionless":
        friction = 0.0
    roller = Roller(
        radius, indentation=depth, friction=friction, rolling=rolling, profile="deformed" if sticks else "circle"
    )
    # a driven roller pulls with a share of its friction at the mean pressure of a soft contact
    bearing = float(material.yield_pressure(k)) * np.sqrt(2 * radius * depth) * 0.5
    torque = share * friction * bearing * radius if rolling == "driven" else None
    return Lift(Layer(height + depth), roller, material, torque)


def outcome(lift: Lift, increments: int = INCREMENTS) -> str:
    """Return the answer for a lift in one line."""
    start = time.process_time()
    try:
        found = roll(*lift[:3], SPEED, torque=lift.torque, increments=increments)
    except HeapingError as error:
        return f"heaps up    {time.process_time() - start:5.1f} s   {str(error)[:150]}"
    except UnsteadyError as error:
        return f"not decided {time.process_time() - start:5.1f} s   {str(error)[:150]}"
    error = found.error or (np.nan, np.nan)
    return (
        f"steady      {time.process_time() - start:5.1f} s   load {found.load:8.1f} +- {100 * error[0]:.2f} %   "
        f"resistance {found.resistance:8.2f} +- {100 * error[1]:.2f} %   work {found.work_residual:.1e}   wave "
        f"{1e3 * found.bow_wave:.2f} mm   k {found.exit_density_ratio:.4f} {found.peak_density_ratio:.5f}   "
        f"{found.effort.split(';')[1].split()[0]} steps"
    )


def main(arguments: Sequence[str] | None = None) -> list[str]:
    """Print a line for each lift, and the counts of the answers; return the lines."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("numbers", nargs="*", type=int)
    parser.add_argument("--seed", type=int, default=2026, choices=COUNTS)
    parser.add_argument("--increments", type=int, default=INCREMENTS)
    parser.add_argument("--constant", default="", metavar="NAME=VALUE")
    given, lines = parser.parse_args(arguments), []
    name, _, value = given.constant.partition("=")
    if name:
        setattr(steady_search, name, type(getattr(steady_search, name))(value))
    for number in given.numbers or range(COUNTS[given.seed]):
        lift = random_lift(given.seed, number)
        kind = f"{lift.roller.rolling} {lift.roller.friction:.2f} depth {1e3 * lift.roller.indentation:.2f} mm"
        answer = outcome(lift, given.increments)
        lines.append(f"{number:3d} {kind:35s} {answer}")
        print(lines[-1], flush=True)
    counts = Counter(line[40:52].strip() for line in lines)
    print(", ".join(f"{count} {answer}" for answer, count in counts.items()))
    return lines


if __name__ == "__main__":
    main()
