"""The command line: its program, and the options that commands share.

The program is imported inside `main`, so that an interrupt of its import ends as any other.
"""

import os
import signal
import sys
import threading
import time

__all__ = ["main"]

INTERRUPTED = 130  # exit code
INTERRUPTED_MESSAGE = "interrupted; every file already written is whole"


def main() -> None:
    """Run the command line and exit; every failure prints one sentence and sets an exit code.

    An interrupt of the import is kept until its end: some modules of compiled code clear the error that it raises.
    """
    sys.unraisablehook = _repeat_interrupt
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


def _repeat_interrupt(ignored: "sys.UnraisableHookArgs") -> None:
    """Interrupt once more if Python has dropped an interrupt, as it drops whatever a callback raises."""
    if issubclass(ignored.exc_type, KeyboardInterrupt):
        threading.Thread(target=_interrupt_again, daemon=True).start()
    else:
        sys.__unraisablehook__(ignored)


def _interrupt_again() -> None:
    """Send the signal once the main thread has left the hook, in which Python would drop it again."""
    from traceback import walk_stack  # 10 ms, which no other start pays

    main_thread = threading.main_thread().ident
    assert main_thread is not None
    while _repeat_interrupt.__code__ in (frame.f_code for frame, _ in walk_stack(sys._current_frames()[main_thread])):
        time.sleep(0.01)
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(main_thread, signal.SIGINT)
    else:
        signal.raise_signal(signal.SIGINT)
