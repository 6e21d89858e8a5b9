"""Explanation of a number of summary.json: value, range, chain of models, inputs with origin, fits, sources, theory.

All of it is read from the summary, so that `compact explain` computes nothing. A key is a name, such as "peak_force",
the first of which counts, the decision before all others; or a path, "work_balance.feed_ratio".
"""

from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from typing import Any, NamedTuple

from compact.files import ResultsError
from compact.report.tables import format_number, format_percent, format_quantity

SHOWN = 6  # [-], entries of a list or of a mapping that are shown
NEAREST = 3  # [-], keys named where one is unknown
KNOWN = "published", "measured", "calibrated", "given"  # first words of a clause on the origin of an input
ORIGINS = (*KNOWN, "assumed", "guess", "derived", "default", "changed by the caller")


class Link(NamedTuple):
    """Model in a chain: words, inputs by table of the scene, and page of the theory."""

    words: str
    inputs: str
    page: str


LINKS = {
    "mix": Link("prior of the mix with the values of the scene", "mix:moisture,density_ratio mix.overrides:*",
                "theory/strength.md"),
    "contact": Link("contact of one roller by {engine}", "machine:roller_radius,roller_length "
                    "layer:lift_thickness,fed_density_ratio,passes", "theory/compaction.md"),
    "resistance": Link("resistance of a cart over speed and stroke",
                       "machine:rollers,roller_friction,guide_friction,sleeve_distance", "theory/resistance.md"),
    "law": Link("motion law", "motion:stroke,duration,dwell,run_up,run_down", "theory/laws.md"),
    "drive": Link("{drive} drive over a cycle", "machine:mass,weight drive:kind,stiffness,damping",
                  "theory/drives.md"),
    "shaft": Link("shaft that turns uniformly", "drive:carts", "how_to/motor.md"),
    "cam": Link("cam of constant breadth", "cam:breadth,roller_follower_radius", "how_to/cams.md"),
    "air": Link("pore air", "mix:pore_air", "theory/pore_air.md"),
    "balance": Link("balance of mix and work", "product:width,height,mould_speed", "theory/process.md"),
    "sources": Link("sources of uncertainty", "", "how_to/answer.md"),
}  # fmt: skip
CONTACT_PAGES = {"formula": "theory/formulas.md", "process": "theory/process.md"} | dict.fromkeys(
    ("spectral", "fem"), "theory/contact.md"
)
FORCE = "mix contact resistance"
CHAINS = {  # links -> keys, or tables of the summary; of a key that has none its table counts
    FORCE: "drive_resistance return_stroke steady_forces comparison prior_resistance fitted_resistance",
    f"{FORCE} law drive": "peak_force peak_power laws rankings robust_laws",
    f"{FORCE} law drive shaft": "shaft_torque motor_rating machine_sizing",
    f"{FORCE} law drive sources": "decision verdict",
    f"{FORCE} balance": "work_balance",
    "mix contact": "roller_load held model_spread numbers contacts", "mix contact air": "pore_air",
    "law": "peak_jerk", "law cam": "pressure_angle cam",
}  # fmt: skip


def explanation(summary: Mapping[str, Any], key: str) -> list[str]:
    """Explain a number of a summary in lines of text.

    Parameters
    ----------
    summary : mapping
        Content of summary.json.
    key : str
        Name or path, its parts joined by dots.

    Raises
    ------
    ResultsError
        If the summary has no such key; the nearest ones are named.
    """
    path, value = next((each for each in _items(summary) if key in (each[0][-1], ".".join(each[0]))), ((), None))
    if not path:
        names = {path[-1] for path, _ in _items(summary)}
        near = get_close_matches(key, sorted(names), NEAREST) or list(summary["decision"]["sizes"])[:NEAREST]
        raise ResultsError(f"summary.json has no key {key!r}; the nearest are {', '.join(near)}")
    chains = {name: chain for chain, names in CHAINS.items() for name in names.split()}
    chain = next((chains[name] for name in reversed(path) if name in chains), "sources")
    links = [LINKS[name] for name in chain.split()]
    decision = summary.get("decision") or {"engine": summary["engine"], "fitted": []}
    told = {"engine": decision["engine"], "drive": summary["inputs"]["drive"]["kind"]["value"]}
    found = [f"{key}: {worded(value)}", f"from: {' → '.join(link.words.format(**told) for link in links)}"]
    wanted = " ".join(link.inputs for link in links).split()
    found += [f"{origin}: {', '.join(each)}" for origin, each in _origins(summary["inputs"], wanted).items()]
    fitted = ", ".join(decision["fitted"]) if LINKS["mix"] in links else ""
    found += [f"fitted: {fitted or 'nothing'}"]
    if isinstance(value, Mapping) and value.get("shares") and "margin" in value:
        shares = (f"{name} {format_percent(share)}" for name, share in value["shares"].items())
        found += [f"margin of {format_percent(value['margin'])}, of its square: {', '.join(shares)}"]
    pages = [CONTACT_PAGES.get(told["engine"], link.page) if "{engine}" in link.words else link.page for link in links]
    return [*found, f"theory: {', '.join(f'docs/{page}' for page in dict.fromkeys(pages))}"]


def worded(value: Any, depth: int = 0) -> str:
    """Return a value of a summary as text, a quantity with its unit and range; deep tables by their length."""
    if isinstance(value, Mapping) and "unit" in value:
        known = value.get("value", value.get("high"))
        words = format_quantity(known, value["unit"], 3) if _numeric(known) else known or "unknown"
        ends = [format_quantity(value[name], value["unit"], 3) for name in ("low", "high") if _numeric(value.get(name))]
        return f"{words}, {' to '.join(ends)}" if len(ends) > 1 else words
    if depth > 1 and isinstance(value, Mapping | list):
        return f"{len(value)} entries"
    if isinstance(value, Mapping):
        found = [f"{name} {worded(each, depth + 1)}" for name, each in list(value.items())[:SHOWN]]
    elif isinstance(value, list):
        found = [worded(each, depth + 1) for each in value[:SHOWN]]
    else:
        return format_number(value, 3) if _numeric(value) else str(value)
    more = len(value) - len(found)
    return "; ".join([*found, *([f"{more} more"] if more > 0 else [])]) or "none"


def _numeric(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _items(summary: Mapping[str, Any]) -> list[tuple[tuple[str, ...], Any]]:
    """Return paths and values of all keys: those of the sizes first, then those of the decision, then by depth."""

    def below(path: tuple[str, ...], value: Any) -> Iterator[tuple[tuple[str, ...], Any]]:
        for name, each in value.items() if isinstance(value, Mapping) and "unit" not in value else ():
            yield (*path, name), each
            yield from below((*path, name), each)

    def order(item: tuple[tuple[str, ...], Any]) -> tuple[bool, int]:
        path, _ = item
        return path[:2] != ("decision", "sizes"), len(path)

    return sorted(below((), {"decision": summary.get("decision"), **summary}), key=order)


def _origins(inputs: Mapping[str, Any], wanted: Sequence[str]) -> dict[str, list[str]]:
    """Return inputs with their values by the origin that their comments state first."""
    found: dict[str, list[str]] = {}
    for table, _, names in (each.partition(":") for each in wanted):
        given = inputs.get(table, {})
        for name in given if names == "*" else (each for each in names.split(",") if each in given):
            origin = origin_of(given[name]["origin"])[0] or "without origin"
            found.setdefault(origin, []).append(f"{name} {worded(given[name]['value'])}")
    return found


def origin_of(comment: str) -> tuple[str, str]:
    """Return the origin that a clause of a comment states, empty without one, and the rest of the comment."""
    clauses = [clause.strip() for clause in comment.split(";")]
    stated = ((clause, word) for clause in clauses for word in ORIGINS if clause.startswith(word))
    clause, word = next(stated, ("", ""))
    rest = [clause.removeprefix(word).strip(" :,"), *(each for each in clauses if each != clause)]
    return word, "; ".join(filter(None, rest))
