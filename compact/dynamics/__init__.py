"""Equations of motion of an elastically driven cart, with impact, backlash and stick."""
