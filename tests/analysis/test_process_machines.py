"""Forming process of other machines by columns: hard cases, ten random machines, a plate with three rollers."""

import numpy as np
import pytest
from sampling import sampled

from compact.analysis.process import ProcessStudy
from compact.scene.loader import load_scene

FEW = {"process.layers": 1, "machine.roller_length": 0.4}
AT_REST = {"process.mould_speed": 0.0}
OPEN = {"process.product_density_ratio": None}
HARD = {
    "product thinner than a bite": {"product.height": 0.005, "unusual": ["product.height"]},
    "one stroke": AT_REST | OPEN | {"process.strokes": 1, "process.gap": 0.004},
    "mould at rest": AT_REST | {"process.strokes": 60},
    "feed below the demand": OPEN | {"process.extrusion_pressure": 203e3, "process.offered_thickness": 1e-4},
    "dry": {"mix.moisture": 0.08},
    "wet": {"mix.moisture": 0.12},
    "extrusion by the wedge": OPEN,
    "plate of 100 mm, three rollers": {
        "product.height": 0.1, "machine.rollers": 3, "machine.roller_positions": [0.3, 0.0, -0.3],
    },
}  # fmt: skip
PASS = 0.4 / 0.45  # [s]
REMEDIES = ("are needed", "give ", "feed less", "choose")  # of refusals


def balanced(changes):
    """Numbers of a process whose mix and work close, and whose resistance is not below its floor."""
    study = ProcessStudy(load_scene("process", **FEW | changes))
    numbers = study.row.numbers
    assert abs(numbers["mass_residual"]) < 1e-12
    assert numbers["work_residual"] < 1e-12
    assert numbers["confined_floor"] <= numbers["resistance"] * (1 + 1e-9)
    return study, numbers


@pytest.mark.sampled(4)
@pytest.mark.parametrize("changes", HARD.values(), ids=HARD)
def test_hard_cases_close_their_balances(changes):
    study, numbers = balanced(changes)
    assert numbers["load"] > 0
    assert all(part.force is None or np.isfinite(part.force) for part in study.parts)


@pytest.mark.slow
def test_ten_thousand_strokes_close_their_balances():
    slow = 1.0001 * FEW["machine.roller_length"] / (10_000 * PASS)
    _, numbers = balanced({"process.mould_speed": slow, "unusual": ["process.mould_speed"]})
    assert numbers["strokes"] == pytest.approx(9999, abs=1)


def machine(seed):
    rng = np.random.default_rng((2028, seed))
    density = float(rng.uniform(0.945, 0.985))
    return {
        "machine.roller_radius": float(rng.uniform(0.05, 0.11)), "machine.roller_length": float(rng.uniform(0.2, 1.5)),
        "product.height": float(rng.uniform(0.05, 0.4)), "process.mould_speed": float(10 ** rng.uniform(-2.3, -1.2)),
        "motion.duration": float(rng.uniform(0.4, 2.0)), "process.feed_density_ratio": float(rng.uniform(0.73, 0.85)),
        "mix.moisture": float(rng.uniform(0.08, 0.12)), "process.product_density_ratio": density,
        "mix.density_ratio": density, "unusual": ["process.mould_speed", "motion.duration"],
    }  # fmt: skip


@pytest.mark.parametrize("seed", sampled(range(10), range(2)))
def test_a_random_machine_has_results_or_a_remedy(seed):
    try:
        balanced(machine(seed))
    except ValueError as error:
        assert any(words in str(error) for words in REMEDIES), error  # noqa: PT017
