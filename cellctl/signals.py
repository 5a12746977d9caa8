"""Signals that end a process. Imported before everything else: it imports nothing slow."""

import signal


def sigterm_as_sigint() -> None:
    """From now on SIGTERM ends the process as Ctrl-C does, by the handler that SIGINT has then.

    A job that a script's shell starts with `&` has SIGINT ignored: there SIGTERM raises KeyboardInterrupt itself.
    """
    ignored = signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    to_its_handler = signal.default_int_handler if ignored else lambda *_: signal.raise_signal(signal.SIGINT)
    signal.signal(signal.SIGTERM, to_its_handler)
