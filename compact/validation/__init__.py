"""Validation: results of the engines held to measurements, programs and models of others."""
