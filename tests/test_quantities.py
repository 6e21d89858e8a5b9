"""Quantities: every record field has a term and a unit, and one term has one unit."""

import pytest

from compact import quantities
from compact.quantities import Quantity

TABLES = {name: table for name, table in vars(quantities).items() if isinstance(table, dict) and "UNIT" not in name}
TABLES = {name: table for name, table in TABLES.items() if name.isupper() and name != "PLOT_FACTORS"}


@pytest.mark.parametrize("table", TABLES)
def test_terms_and_units_are_complete_and_one_term_has_one_unit_of_plots(table):
    units = {}
    for name, quantity in TABLES[table].items():
        assert quantity.term, name
        assert quantity.unit, name
        assert quantity.term[0].islower() or not quantity.term[0].isalpha(), name
        assert quantity.plot_factor > 0
        assert units.setdefault(quantity.term, quantity.shown_unit) == quantity.shown_unit
    assert len(TABLES) == 12


def test_labels_and_columns_have_term_symbol_and_unit():
    assert Quantity("speed", "m/s", symbol="v").axis_label == "speed v [m/s]"
    assert Quantity("peak drive force", "N", "kN").axis_label == "peak drive force [kN]"
    assert Quantity("acceleration", "m/s2").axis_label == "acceleration [m/s²]"
    assert Quantity("density ratio", "1", symbol="k").axis_label == "density ratio k [-]"
    assert quantities.column_names({name: quantities.CONTACT[name] for name in ("load", "coefficient")}) == (
        "load_N/m",
        "coefficient",
    )
