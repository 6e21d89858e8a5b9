"""The scene file: tables and keys, rules between keys, plausible ranges, and messages that name line and key."""
