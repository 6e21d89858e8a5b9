"""What processes that tests start, and interrupt, are begun with."""

import signal


def heed_interrupts():
    """A shell lets what it starts in the background ignore them."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
