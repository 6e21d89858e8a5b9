"""Stages of a study: contacts, resistance, laws, drives, comparison of engines, uncertainty; each is entered once."""
