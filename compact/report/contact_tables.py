"""What is said of the contact of a scene: tables over its speeds, one contact in full, and a digest in text."""

import numpy as np

from compact.analysis.contact_cases import contact_record, contact_to_json
from compact.analysis.engines import COMPACTING, FIELDED, fields, roll
from compact.files import write_csv, write_figure, write_json

ENGINE_HEADER = (
    "speed_m/s", "load_N/m", "resistance_N/m", "coefficient", "leading_m", "trailing_m", "peak_pressure_Pa",
    "load_error", "resistance_error", "work_residual", "iterations",
)  # fmt: skip
CONTACT_HEADER = (*ENGINE_HEADER, "formula_load_N/m", "formula_coefficient", "exact_load_N/m")


def write_contact_tables(study, directory):
    """The contact at each speed by the scene's engine; at the end of each row what the formulas and Galin say."""
    length = study.scene.machine.roller_length
    beside = (
        study.engineering.roller_force / length,
        study.engineering.resistance_coefficient,
        float(study.exact.load),
    )
    yield write_csv(directory / "contact.csv", CONTACT_HEADER, [(*row(each), *beside) for each in study.contacts])
    if study.scene.accuracy.engine in COMPACTING:
        yield from study.standing(directory, "passes.csv", "density.csv") or _passes(study.passes, directory)


def row(contact):
    """One contact in the columns of ENGINE_HEADER."""
    errors = (contact.load_error, contact.resistance_error)
    return (
        contact.speed, contact.load, contact.resistance, contact.coefficient, contact.leading, contact.trailing,
        contact.peak_pressure, *("" if error is None else error for error in errors), contact.work_residual,
        contact.iterations,
    )  # fmt: skip


PASSES_HEADER = (
    "speed_m/s", "pass", "load_N/m", "resistance_N/m", "coefficient", "indentation_m", "exit_height_m",
    "exit_density_ratio", "load_error", "resistance_error", "work_residual", "mass_residual",
)  # fmt: skip


def _passes(passed, directory):
    """What each pass takes and leaves, and the density over the height behind it; even ones go back, so does speed."""
    from compact.analysis.multipass import density

    rows = [
        (speed if number % 2 else -speed, number, rolled)
        for speed, passes in passed
        for number, rolled in enumerate(passes, start=1)
    ]
    yield write_csv(directory / "passes.csv", PASSES_HEADER, [
        (
            speed, number, r.load, r.resistance, r.resistance / r.load, r.indentation, r.exit_height,
            r.exit_density_ratio, *(r.error or ("", "")), r.work_residual, r.mass_residual,
        )
        for speed, number, r in rows
    ])  # fmt: skip
    yield write_csv(directory / "density.csv", ("speed_m/s", "pass", "bottom_m", "top_m", "density_ratio"), [
        (speed, number, *row) for speed, number, r in rows for row in density(r).tolist()
    ])  # fmt: skip


def pressure(study, directory):
    """Path of the picture of the pressure along one contact, at the mean speed or the nearest that was computed."""
    if standing := study.standing(directory, "pressure.png"):
        return standing[0]
    from compact.report import figures

    speed = study.scene.mean_speed
    if study.layered:
        speed, rolled = min(study.rolled, key=lambda pair: abs(np.log(pair[0] / speed)))
    else:
        rolled = roll(study.scene, study.mix, speed)
    return write_figure(directory / "pressure.png", figures.contact(rolled, study.exact, speed))


def write_contact(directory, study, speed, passes):
    """Write one contact, the first of its passes: pressure along it, its numbers, a picture beside Galin, its fields
    where it has any, and what all passes take and leave where they leave a mark."""
    from compact.report import figures

    rolled = passes[0]
    columns = np.column_stack([rolled.x, rolled.pressure, rolled.shear_traction]).tolist()
    write_csv(directory / "pressure.csv", ("x_m", "pressure_Pa", "shear_traction_Pa"), columns)
    engine = study.scene.accuracy.engine
    replaced = {"replaced": list(study.scene.replacements[engine])}
    write_json(directory / "contact.json", contact_to_json(contact_record(engine, speed, passes)) | replaced)
    write_figure(directory / "pressure.png", figures.contact(rolled, study.exact, speed))
    if study.scene.accuracy.engine in COMPACTING:
        list(_passes([(speed, passes)], directory))
        write_figure(directory / "density.png", figures.density(passes))
    if study.scene.accuracy.engine in FIELDED:
        from compact.engines.fem.fields import write_series

        layers = [(fields(rolled, study.scene.accuracy.engine), rolled)]
        list(write_series(layers, directory))
        write_figure(directory / "fields.png", figures.fields(layers))


def contact_digest(study, speed, passes):
    """One contact in a few lines of text, the formulas and exact theory beside it, and its passes if they are many."""
    rolled = passes[0]
    formulas, exact, length = study.engineering, study.exact, study.scene.machine.roller_length
    resistance = rolled.resistance, formulas.roller_resistance / length
    rows = [
        ("load [N/m]", rolled.load, formulas.roller_force / length, exact.load),
        ("  a roller [N]", rolled.load * length, formulas.roller_force, exact.load * length),
        ("resistance [N/m]", *resistance, np.nan),
        ("  a roller [N]", *(length * each for each in resistance), np.nan),
        ("resistance/load", rolled.resistance / rolled.load, formulas.resistance_coefficient, np.nan),
        ("contact length [m]", rolled.leading - rolled.trailing, formulas.contact_length, exact.contact_length),
        (
            "leading edge [m]",
            rolled.leading,
            study.scene.machine.roller_radius * np.sin(formulas.capture_angle),
            exact.leading,
        ),
        ("peak pressure [Pa]", rolled.peak_pressure, formulas.pressure, exact.peak_pressure),
    ]
    lines = [
        f"{'at ' + format(speed, 'g') + ' m/s':<20}{study.scene.accuracy.engine:>12}{'eqs 1.5-1.8':>14}{'Galin':>12}"
    ]
    lines += [
        f"{name:<20}{_cell(ours):>12}{_cell(formula):>14}{_cell(galin):>12}" for name, ours, formula, galin in rows
    ]
    lines.append(f"a roller is {length:g} m long, the cart has {study.scene.machine.rollers}")
    if rolled.error:
        lines.append(f"error of the load {rolled.error[0]:.1e}, of the resistance {rolled.error[1]:.1e}")
        if hasattr(rolled, "exit_density_ratio"):
            k, height = rolled.exit_density_ratio, rolled.exit_height
            lines.append(
                f"density ratio {k:.4f} behind the roller, {height * 1e3:.2f} mm high; mass closes to "
                f"{abs(rolled.mass_residual):.1e}"
            )
        if getattr(rolled, "over_pressed", False):
            lines.append(f"over-pressed: the mix passes full density, {rolled.peak_density_ratio:.3f} at most")
        lines.append(f"energy balance closes to {rolled.work_residual:.1e}; {_effort(rolled)}")
    if study.held is not None:
        lines.append(held_sentence(study))
    lines += study.scene.replacements[study.scene.accuracy.engine]
    if len(passes) > 1:
        lines += ["", "pass   load [N/m]   resistance [N/m]   height behind [mm]   density ratio"]
        lines += [_pass_line(number, passed) for number, passed in enumerate(passes, start=1)]
    return "\n".join(lines)


def held_sentence(study):
    """The quantity of the contact that is kept over speed, in a sentence of text; "" for the formulas."""
    held = study.held
    if held is None:
        return ""
    kept = {
        "height": f"the height of the roller, {held.value * 1e3:.4g} mm deep",
        "load": f"the load, {held.value * study.scene.machine.roller_length:.4g} N on a roller",
        "peak_pressure": f"the peak pressure, {held.value / 1e3:.4g} kPa",
    }
    return f"kept at every speed: {kept[held.name]}, found at {held.speed:.4g} m/s for {_target(study)}"


def _target(study):
    """The target that the contact meets at the mean speed."""
    for name, given in study.scene.target.items():
        return {
            "indentation": f"the prescribed indentation of {given * 1e3:.4g} mm",
            "load": f"the prescribed load of {given:.4g} N on a roller",
            "peak_pressure": f"the prescribed peak pressure of {given / 1e3:.4g} kPa",
        }[name]
    if study.scene.accuracy.engine in COMPACTING:
        return f"the density ratio {study.scene.mix.density_ratio:g} of the product"
    return f"the peak pressure of {study.mix.required_pressure / 1e3:.4g} kPa that the density requires"


def return_sentence(study):
    """The mix under the return stroke, in a sentence of text, with the energy of a cycle where both are computed."""
    if not study.cycle_energies:
        why = "a linear layer recovers" if study.layered else "the formulas state no other"
        return f"return stroke: over fresh mix, the same resistance as on the way out ({why})"
    load, resistance = study.second_pass
    fresh, compacted = (study.cycle_energies[over] for over in ("fresh", "compacted"))
    law = next(iter(study.rankings.values()))[0].run.name
    return (
        f"return stroke: over {study.scene.layer.return_stroke} mix; over the compacted mix it takes {load:.1%} of the "
        f"load and {resistance:.1%} of the resistance; energy of a cycle under {law}: {fresh:.4g} J over fresh mix, "
        f"{compacted:.4g} J over compacted mix"
    )


def guide_sentence(study):
    """The forces that the drive overcomes at the mean speed, in a sentence of text, and why eq 1.9 has another."""
    steady, machine, formula = study.steady, study.scene.machine, study.engineering
    force, guides = (float(each[0]) for each in (steady.drive_force, steady.guide_friction))
    return (
        f"drive force at the mean speed: {force:.4g} N, of which {guides:.3g} N at the guide wheels (guide_friction "
        f"{machine.guide_friction:g}); eq 1.9 gives {formula.cart_resistance:.4g} N, its guide wheels with the "
        f"coefficient {formula.guide_coefficient:.3g} from journal, rolling arm and rib: a comparison, not used by the "
        "drives"
    )


def _cell(value):
    return f"{value:.5g}" if np.isfinite(value) else "-"


def _effort(rolled):
    """What an engine went through, in words."""
    if hasattr(rolled, "evaluations"):
        return f"evaluations: {rolled.evaluations}"
    march = getattr(rolled, "march", None)
    if march is None:
        return f"iterations: {len(rolled.history)}"
    how = "balance found at once" if march.at_once else f"marched {len(rolled.steps)} steps"
    return f"forces to {rolled.equilibrium_residual:.1e}; {how}; bow wave {rolled.bow_wave * 1e3:.2f} mm"


def _pass_line(number, passed):
    """A pass in a line; its resistance is against its travel, there or back."""
    against = passed.resistance if number % 2 else -passed.resistance
    return (
        f"{number:>4}{passed.load:>13.5g}{against:>19.4g}{passed.exit_height * 1e3:>21.2f}"
        f"{passed.exit_density_ratio:>16.4f}"
    )
