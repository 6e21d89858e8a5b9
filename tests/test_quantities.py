"""Quantities: every record field has a term and a unit, and one term has one unit."""

import pytest

from compact import quantities
from compact.quantities import Quantity

TABLES = ("CONTACT", "PASS", "FORMULA", "SWEEP_POINT", "CRITERIA", "RUN", "ROLLER_MOTOR", "MOTION", "FIELD", "INPUT")


@pytest.mark.parametrize("table", TABLES)
def test_terms_and_units_are_complete(table):
    for name, quantity in getattr(quantities, table).items():
        assert quantity.term, name
        assert quantity.unit, name
        assert quantity.term[0].islower() or not quantity.term[0].isalpha(), name
        assert quantity.plot_factor > 0


def test_one_term_has_one_unit_of_plots_within_a_table():
    for table in TABLES:
        units = {}
        for quantity in getattr(quantities, table).values():
            assert units.setdefault(quantity.term, quantity.shown_unit) == quantity.shown_unit


@pytest.mark.parametrize(
    ("quantity", "label"),
    [
        (Quantity("speed", "m/s", symbol="v"), "speed v [m/s]"),
        (Quantity("peak drive force", "N", "kN"), "peak drive force [kN]"),
        (Quantity("acceleration", "m/s2"), "acceleration [m/s²]"),
        (Quantity("density ratio", "1", symbol="k"), "density ratio k [-]"),
    ],
)
def test_axis_label_has_term_symbol_and_typeset_unit(quantity, label):
    assert quantity.axis_label == label


def test_column_names_carry_the_unit():
    assert quantities.column_names(quantities.CONTACT, "load", "coefficient") == ("load_N/m", "coefficient")
