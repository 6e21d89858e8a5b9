"""Figures of a study, a contact, a ranking and a sweep by matplotlib."""
