"""Sequences of lumped lifts from given functions of the mean density, without finite elements."""

import numpy as np

from compact.engines.process.lifts import LiftSequence, LumpedLift


def sequence(thickness=0.005, increments=6, to=0.95, load=lambda k: 1e3, work=lambda k: 1e5, **changes):
    """Lifts whose load [N/m] and resistance over thickness [N/m2] are functions of the mean density."""
    edges = np.linspace(0.75, to, 12)
    lifts = [
        LumpedLift(
            thickness=thickness, bite=thickness, load=load(k), resistance=work((before + k) / 2) * thickness,
            load_error=0.01, resistance_error=0.05, density_before=before, density_ratio=k,
            bottom_density_ratio=k - 0.07, top_density_ratio=k + 0.09, saturated_height=0.01, surface=0.22,
            peak_pressure=5e5, work_residual=0.01, mass_residual=1e-4,
            rows=((0.11, k - 0.05, 1e4), (0.11, k + 0.05, 3e4)),
            air_load=2e4 * thickness, air_resistance=1e4 * thickness**2, air_excess_behind=2e3,
        )
        for before, k in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)
    ]  # fmt: skip
    return LiftSequence(thickness, increments, tuple(lifts), **changes)
