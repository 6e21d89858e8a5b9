"""The command line: its program, the commands on tests and checks, and the options that commands share.

The program is imported inside `main`, so that an interrupt of its import ends as any other.
"""

import os
import signal
import sys
import threading

__all__ = ["main"]

INTERRUPTED = 130  # exit code
INTERRUPTED_MESSAGE = "interrupted; every file already written is whole"


def main() -> None:
    """Run the command line and exit; every failure prints one sentence and sets an exit code."""
    sys.unraisablehook = _repeat_interrupt
    try:
        from compact.cli.program import main as run

        run()
    except KeyboardInterrupt:  # before or after the command itself
        print(f"compact: {INTERRUPTED_MESSAGE}", file=sys.stderr, flush=True)
        os._exit(INTERRUPTED)


def _repeat_interrupt(ignored: "sys.UnraisableHookArgs") -> None:
    """Interrupt once more if Python has dropped an interrupt, as it drops whatever a callback raises."""
    if not issubclass(ignored.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(ignored)
    elif hasattr(signal, "pthread_kill"):
        main_thread = threading.main_thread().ident
        threading.Timer(0.01, signal.pthread_kill, (main_thread, signal.SIGINT)).start()
    else:
        threading.Timer(0.01, signal.raise_signal, (signal.SIGINT,)).start()
