"""The console script: each call ends with a fixed exit code and in words, from the first import on."""

import sys


def main() -> None:
    """Run `cellctl` with the words of the command line."""
    try:  # the imports take a while, and Ctrl-C does not wait for them
        import signal

        signal.signal(signal.SIGTERM, lambda *_: signal.raise_signal(signal.SIGINT))  # whoever handles that one
        from cellctl.cli import ends, streams
        from cellctl.cli.verbs import app

        streams.prepare()
        code = ends.exit_code_of(lambda: app(standalone_mode=False))
        for number in (signal.SIGINT, signal.SIGTERM):  # it is over: nothing is left to be aborted
            signal.signal(number, signal.SIG_IGN)
    except KeyboardInterrupt:
        print("cellctl: aborted by the operator", file=sys.stderr)
        code = 130
    sys.exit(code)
