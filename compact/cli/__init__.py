"""The command line: its program, the commands on tests and checks, and the options that commands share."""

from compact.cli.program import app, main

__all__ = ["app", "main"]
