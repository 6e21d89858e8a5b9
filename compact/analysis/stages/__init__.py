"""Stages of a study: contacts, resistance, laws, drives, comparison of engines, sensitivity; each is entered once."""
