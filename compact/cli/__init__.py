"""The command line: its program, and the options that commands share.

The program is imported inside `main`, so that an interrupt of its import ends as any other.
"""

import os
import signal
import sys

__all__ = ["main"]

INTERRUPTED = 130  # exit code
INTERRUPTED_MESSAGE = "interrupted; every file already written is whole"


def main() -> None:
    """Run the command line and exit; every failure prints one sentence and sets an exit code.

    An interrupt of the import is kept until its end: some modules of compiled code clear the error that it raises.
    """
    kept: list[int] = []
    heeded = signal.getsignal(signal.SIGINT) is signal.default_int_handler  # not where a shell lets it be ignored
    try:
        if heeded:
            signal.signal(signal.SIGINT, lambda number, _: kept.append(number))
        from compact.cli.program import main as run

        if heeded:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        if kept:
            raise KeyboardInterrupt
        run()
    except KeyboardInterrupt:  # before or after the command itself
        print(f"compact: {INTERRUPTED_MESSAGE}", file=sys.stderr, flush=True)
        os._exit(INTERRUPTED)
