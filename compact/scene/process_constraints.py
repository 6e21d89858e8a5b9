"""Rules between the keys of [process] and [sleeve], and advice; bounds of a single key are in `schema`.

The rules are those of `constraints`: functions of the values of their keys, absent optional keys being None. A scene
without the table [process] has no `process.mould_speed`, and no rule of the table applies.
"""

import math
from functools import partial
from itertools import pairwise

from compact.scene.choices import NIP_ANGLE, STROKES_LIMIT
from compact.scene.constraints import GUARD, Rule, rule

PROCESS_RULES: list[Rule] = []
PROCESS_ADVICE: list[Rule] = []
CLOSURES = ("gap", "product_density_ratio", "extrusion_pressure")

_process_rule = partial(rule, into=PROCESS_RULES)


@_process_rule("process.mould_speed", "process.strokes")
def _mould_at_rest_has_strokes(speed, strokes):
    if speed == 0 and strokes is None:
        return "is 0, and process.strokes is missing; give the number of strokes over a mould at rest, or its speed"
    if speed and strokes is not None:
        return (
            f"is {speed:g} m/s, so that roller length and stroke determine the number of strokes, got "
            f"process.strokes = {strokes:g}; take one of the two out"
        )
    return None


@_process_rule("process.mould_speed", "machine.roller_length", "motion.duration", "motion.dwell")
def _mould_moves_by_less_than_the_roller(speed, length, duration, dwell):
    if not speed:
        return None
    period = duration + dwell
    if speed * period > length * GUARD:
        return (
            f"must be at most machine.roller_length over the time of a stroke, {length / period:.4g} m/s, got "
            f"{speed:g}; parts of the product would pass between two strokes"
        )
    if length / (speed * period) > STROKES_LIMIT:
        return (
            f"must be at least {length / (period * STROKES_LIMIT):.4g} m/s, for {STROKES_LIMIT} strokes on a section, "
            f"got {speed:g}; give 0 with process.strokes for a mould at rest"
        )
    return None


@_process_rule("accuracy.engine", "process")
def _engine_has_a_process(engine, process):
    if engine != "process":
        return None
    if process is None:
        return (
            'is "process", and the table [process] is missing; give the mould\'s speed, the feed and one closure, or '
            'choose "column" or "compaction" for a single pass'
        )
    if process["mould_speed"] == 0:
        return (
            'is "process", and process.mould_speed is 0: sections of a mould at rest have all had the same strokes, so '
            "that the rollers have no steady resistance; give the speed of the mould"
        )
    return None


@_process_rule("process.mould_speed", "product.mould_speed")
def _mould_has_one_speed(speed, of_product):
    if None not in (speed, of_product) and speed != of_product:
        return f"must be product.mould_speed = {of_product:g} m/s, got {speed:g}; take product.mould_speed out"


@_process_rule("process.fill_height", "process.fill_density_ratio")
def _fill_has_height_and_density(height, ratio):
    if (height is None) != (ratio is None):
        missing = "fill_height" if height is None else "fill_density_ratio"
        return f"process.{missing} is missing; give both, or neither for an empty mould that the first sleeve fills"


@_process_rule("process.fill_height", "product.height", "machine.roller_radius", "process.nip_angle")
def _fill_is_within_the_nip(fill, height, radius, angle):
    if fill is None:
        return None
    limit = height + _bite(radius, angle)
    if fill > limit * GUARD:
        return (
            f"must be at most product.height + R (1 - cos nip) = {limit:.4g} m, got {fill:g}: the roller would have to "
            "draw mix in beyond its nip angle; give a lower fill or a larger process.nip_angle"
        )


@_process_rule("process.gap", "process.product_density_ratio", "process.extrusion_pressure", "process.mould_speed")
def _one_closure(gap, ratio, pressure, speed):
    if speed is None:
        return None
    given = [name for name, value in zip(CLOSURES, (gap, ratio, pressure), strict=True) if value is not None]
    if len(given) != 1:
        found = " and ".join(given) or "none"
        remedy = "take the others out" if given else "give process.product_density_ratio for a known product"
        return f"exactly one of {', '.join(CLOSURES)} must be given, got {found}; {remedy}"


@_process_rule("process.gap", "process.feed", "machine.roller_radius", "process.nip_angle")
def _gap_belongs_to_room_within_the_nip(gap, feed, radius, angle):
    if gap is None:
        return None
    if feed not in (None, "room"):
        return (
            f'is for process.feed "room", got {gap:g} with "{feed}"; give process.product_density_ratio or '
            'process.extrusion_pressure, or choose "room"'
        )
    limit = _bite(radius, angle)
    if gap > limit * GUARD:
        return (
            f"must be at most R (1 - cos nip) = {limit:.4g} m, got {gap:g}: the roller would have to draw mix in "
            "beyond its nip angle; give a smaller gap or a larger process.nip_angle"
        )


@_process_rule("process.product_density_ratio", "process.fill_density_ratio", "process.feed_density_ratio")
def _product_is_denser_than_its_mix(ratio, fill, feed):
    if ratio is None or feed is None:
        return None
    loose = {"fill_density_ratio": fill, "feed_density_ratio": feed}
    name, value = max(((name, each) for name, each in loose.items() if each is not None), key=lambda pair: pair[1])
    if ratio <= value:
        return f"must be above process.{name} = {value:g}, got {ratio:g}; give the density behind the last stroke"


@_process_rule("process.feed_count", "process.feed")
def _count_belongs_to_first(count, feed):
    return _belongs(count, feed, "first", "the number of fed strokes")


@_process_rule("process.feed_table", "process.feed")
def _table_belongs_to_table(table, feed):
    return _belongs(table, feed, "table", "points { position, relative_thickness }")


@_process_rule("process.feed_table", "machine.roller_length")
def _table_is_along_the_roller(table, length):
    positions = [point["position"] for point in table or ()]
    if any(b <= a for a, b in pairwise(positions)) or (positions and positions[-1] > length * GUARD):
        return (
            f"must have positions that rise one by one up to machine.roller_length = {length:g} m, got {positions}; "
            "give points such as { position = 0.0, relative_thickness = 2.0 }"
        )
    if table and not any(point["relative_thickness"] > 0 for point in table):
        return "must have one positive relative_thickness at least, got none; give the thickness where mix is fed"


@_process_rule("process.offered_thickness", "process.extrusion_pressure")
def _offer_belongs_to_a_pressure(offered, pressure):
    if offered is not None and pressure is None:
        return (
            f"is for process.extrusion_pressure, got {offered:g} without it; take it out: the other closures determine "
            "the feed"
        )


@_process_rule("sleeve", "process.mould_speed")
def _sleeve_belongs_to_a_process(sleeve, speed):
    if sleeve is not None and speed is None:
        return "is for the table [process], which is missing; take the table [sleeve] out, or give [process]"


@rule(
    "machine.rollers", "machine.overlap", "motion.stroke", "product.width", "process.mould_speed", into=PROCESS_ADVICE
)
def _rollers_cover_the_product(rollers, overlap, stroke, width, speed):
    covered = rollers * (stroke - overlap)
    if speed is not None and covered * GUARD < width:
        needed = math.ceil(width / (stroke - overlap) / GUARD) if stroke > overlap else 0
        remedy = f"machine.rollers = {needed}" if needed else "a stroke longer than machine.overlap"
        return (
            f"{rollers:g} rollers side by side, each over its own stroke, press rollers*(stroke - overlap) = "
            f"{covered:.4g} m of product.width = {width:g} m; the whole width needs {remedy}, or another cart"
        )


def _belongs(value, feed, own, content):
    if feed == own and value is None:
        return f'is missing, and process.feed is "{own}"; give {content}'
    if feed != own and value is not None:
        return f'is for process.feed "{own}", got it with "{feed or "room"}"; take it out'
    return None


def _bite(radius, angle):
    return radius * (1 - math.cos(math.radians(NIP_ANGLE if angle is None else angle)))
