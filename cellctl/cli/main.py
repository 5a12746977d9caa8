"""The console script: each call ends with a fixed exit code and a message, from the first import on."""

import signal
import sys


def main() -> None:
    """Run `cellctl` with the words of the command line."""
    try:  # the imports are slow, and Ctrl-C must not wait for them
        from cellctl.signals import sigterm_as_sigint

        sigterm_as_sigint()
        from cellctl.cli import exit_codes, streams
        from cellctl.cli.verbs import app

        streams.prepare()
        code = exit_codes.exit_code_of(lambda: app(standalone_mode=False))
        for number in (signal.SIGINT, signal.SIGTERM):  # the call has ended: there is nothing to abort
            signal.signal(number, signal.SIG_IGN)
    except KeyboardInterrupt:
        print("cellctl: aborted by the operator", file=sys.stderr)
        code = 130
    sys.exit(code)
