"""Rolling resistance of the return stroke over mix that the roller has just compacted.

A frictionless roller moves forward and back by a motion law over compacting mix, by finite elements that move with the
mix. On the forward stroke the resistance increases until the bow wave is complete. On the return stroke it vanishes
within a small fraction of the contact length. Over the compacted mix it is a few per cent, until the roller reaches the
edge of its initial indentation at the end. The layer is thinner than that of the scene. A free roller with friction has
nearly the same resistance.

Limits: the resistance still increases at the reversal, because the bow wave requires a travel of three layer heights.
After a stroke of 0.12 m it is a tenth below that of steady rolling, drawn for comparison. The oscillation is an
artefact of the mesh with the period of one element: 1.3 % with 6 elements per contact length, half as much with 12. The
mean over an element, drawn as a bold line, is 1.3 % higher with 12.
"""

from pathlib import Path

import numpy as np

from compact.analysis.contact_cases import compaction_material, scene_mix
from compact.api.fields import Fields
from compact.engines.compaction import engine as rolling
from compact.engines.compaction.reciprocating import simulate_reciprocating
from compact.motion.profile import law
from compact.report.progress import spinning
from compact.rolling_contact import Layer, Roller
from compact.scene.loader import load_scene

SCENES = Path(__file__).parents[1] / "compact" / "data" / "scenes"
CALIBRATED = {
    "mix.overrides.heckel_slope": 15.228e-6,
    "layer.fed_density_ratio": 0.93430,
}  # calibrated to 9740 N and 0.179
HEADER = ("stroke", "time_s", "position_m", "load_N/m", "resistance_N/m")
SHOWN = (0.6, 1.0, 1.4)  # [-], instants of the frames over the duration of one stroke
RELEASED = 1 / 3  # [-], of the resistance at the reversal, which remains after the release length


def main(
    scene="loveikin-2015",
    height=0.1,
    indentation=0.002,
    stroke=0.12,
    increments=6,
    name="quintic",
    friction=0.0,
    out=None,
):
    """Return the `CompactionTransientResult`; a roller with friction is free."""
    scene = load_scene(SCENES / f"{scene}.toml", **CALIBRATED)
    condition = {"friction": friction, "rolling": "free"} if friction else {}
    roller = Roller(scene.machine.roller_radius, indentation=indentation, profile="deformed", **condition)
    cycle = law(name, stroke, scene.motion.duration).cycle()
    instants = tuple(share * scene.motion.duration for share in SHOWN)
    mix = compaction_material(scene, scene_mix(scene))
    with spinning("both strokes"):
        done = simulate_reciprocating(
            Layer(height), roller, mix, cycle, increments=increments, instants=instants, estimate=False
        )
    if out:
        from compact.files import write_csv

        rows = np.column_stack([done.stroke, done.time, done.position, done.load, done.resistance]).tolist()
        write_csv(Path(out) / "return_stroke.csv", HEADER, rows)
        Fields(done.frames, "time").to_vtk(out)
        with spinning("steady rolling"):
            steady = rolling.roll(Layer(height), roller, mix, stroke / scene.motion.duration, increments=increments)
        _draw(done, roller.radius, increments, steady).savefig(Path(out) / "return_stroke.png", dpi=100)
    return done


def reversal_resistance(done):
    """Return the resistance at the reversal, at the end of the forward stroke [N/m]."""
    return float(done.resistance[done.stroke == 1][-1])


def release_length(done):
    """Return the distance from the reversal [m] in which the resistance decreases to the fraction RELEASED."""
    back = done.stroke == 2
    distance = done.position[done.stroke == 1][-1] - done.position[back]
    remaining = done.resistance[back] / reversal_resistance(done)
    k = int(np.argmax(remaining < RELEASED))
    before = (0.0, 1.0) if k == 0 else (distance[k - 1], remaining[k - 1])
    return float(np.interp(-RELEASED, (-before[1], -remaining[k]), (before[0], distance[k])))


def return_resistance(done):
    """Return the mean resistance of the second half of the return stroke without its last contact length [N/m]."""
    forward, back = done.stroke == 1, done.stroke == 2
    distance = done.position[forward][-1] - done.position[back]
    end = distance[-1] - max(done.leading[forward][-1], -done.trailing[forward][-1])
    return -float(np.mean(done.resistance[back][(distance > end / 2) & (distance <= end)]))


def element_mean(position, resistance, element):
    """Return positions [m] and the mean resistance over one element length [N/m], without the mesh oscillation."""
    order = np.argsort(position)
    x, force = np.asarray(position)[order], np.asarray(resistance)[order]
    work = np.concatenate([[0.0], np.cumsum(np.diff(x) * (force[1:] + force[:-1]) / 2)])
    inside = x[(x >= x[0] + element / 2) & (x <= x[-1] - element / 2)]
    ahead, behind = (np.interp(inside + side * element / 2, x, work) for side in (1, -1))
    return inside, (ahead - behind) / element


def _draw(done, radius, increments, steady):
    """Draw the resistance over the travel compared with steady rolling, and the density at three instants."""
    from matplotlib.figure import Figure

    from compact.report.figures import PALETTE

    figure = Figure(figsize=(10.0, 5.2), layout="constrained")
    grid = figure.add_gridspec(len(done.frames), 2, width_ratios=(1.6, 1.0))
    left = figure.add_subplot(grid[:, 0])
    element = 2 * np.median(np.abs(np.diff(done.position)))  # two steps of travel
    for number, label, color in ((1, "forward stroke", PALETTE[0]), (2, "return stroke", PALETTE[1])):
        of = done.stroke == number
        raw = f"each step, {increments} elements per contact length" if number == 1 else None
        left.plot(done.position[of] * 1e3, done.resistance[of] / 1e3, color="0.6", linewidth=0.8, label=raw)
        place, mean = element_mean(done.position[of], done.resistance[of], element)
        left.plot(place * 1e3, mean / 1e3, color=color, linewidth=2, label=f"{label}, mean over an element length")
    left.axhline(steady.resistance / 1e3, color=PALETTE[2], linestyle="--", label="steady rolling")
    turn = done.position[done.stroke == 1][-1]
    left.axhline(0, color="0.8", linewidth=0.8, zorder=0)
    left.set(
        xlabel="position of the roller [mm]", ylabel="force on the roller, positive against the forward stroke [kN/m]"
    )
    left.set_ylim(top=1.05e-3 * steady.resistance)
    left.legend(frameon=False, fontsize=8, loc="center", bbox_to_anchor=(0.52, 0.47))
    panels = [figure.add_subplot(grid[row, 1]) for row in range(len(done.frames))]
    for ax, share, (time, mesh) in zip(panels, SHOWN, done.frames, strict=True):
        shades = _density(ax, mesh)
        place = float(np.interp(time, done.time, done.position))
        lowest = float(np.interp(time, done.time, done.bottom_height))
        angle = np.linspace(-0.7, 0.7, 100)
        ax.plot((place + radius * np.sin(angle)) * 1e3, (lowest + radius - radius * np.cos(angle)) * 1e3, "k-", lw=0.8)
        ax.set(ylabel="y [mm]", xlim=(-40, turn * 1e3 + 40), ylim=(-4, lowest * 1e3 + 14), aspect="equal")
        ax.axhspan(-4, 0, facecolor="0.85", edgecolor="0.4", hatch="////", linewidth=0)  # the base
        phase = "reversal" if share == 1 else "forward stroke" if share < 1 else "return stroke"
        ax.set_title(f"t = {time:.2g} s, {phase}", fontsize=9)
    panels[-1].set_xlabel("x [mm]")
    figure.colorbar(shades, ax=panels, label="density ratio k [-]", shrink=0.8)
    return figure


def _density(ax, mesh):
    """Draw the density ratio on the displaced elements."""
    from matplotlib.collections import PolyCollection

    places = (mesh.points + mesh.point_data["displacement"])[:, :2] * 1e3
    shades = PolyCollection(
        places[mesh.cells[0].data[:, :4]], array=mesh.cell_data["density_ratio"][0], cmap="cividis", edgecolors="face"
    )
    shades.set_clim(0.93, 1.0)
    ax.add_collection(shades)
    return shades


def show(done):
    """Print the resistance of the forward and the return stroke."""
    forward, back = (done.resistance[done.stroke == number] for number in (1, 2))
    reversal, mean = reversal_resistance(done), return_resistance(done)
    print(f"forward stroke: largest resistance {forward.max():.0f} N/m, at the reversal {reversal:.0f} N/m")
    print(f"return stroke: {mean:.1f} N/m, {mean / reversal:.1%}; largest {-back.min():.0f} N/m")
    print(f"a third of the resistance remains {release_length(done) * 1e3:.2f} mm from the reversal")
    print(f"energy-balance residual {done.work_residual:.2%}, {done.steps} steps, {done.iterations} iterations")


if __name__ == "__main__":
    show(main(out="out/return_stroke"))
