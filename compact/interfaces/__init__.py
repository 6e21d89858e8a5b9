"""Interfaces to other programs: tables of F(v, a), functional mock-up units with the cart, formats of fields."""
