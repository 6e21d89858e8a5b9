"""The command line: its program, the commands on tests and checks, and the options that commands share.

The program is imported inside `main`, so that an interrupt of its import ends as any other.
"""

import os
import sys

__all__ = ["main"]

INTERRUPTED = 130  # exit code
INTERRUPTED_MESSAGE = "interrupted; every file already written is whole"


def main() -> None:
    """Run the command line and exit; every failure prints one sentence and sets an exit code."""
    try:
        from compact.cli.program import main as run

        run()
    except KeyboardInterrupt:  # before or after the command itself
        print(f"compact: {INTERRUPTED_MESSAGE}", file=sys.stderr, flush=True)
        os._exit(INTERRUPTED)
