"""The command line: the only place that prints."""

from __future__ import annotations

import os
import sys

LIBRARIES = ("OPENBLAS", "OMP", "MKL", "VECLIB_MAXIMUM")


def main() -> None:
    """Run the command line; the exit statuses are in docs/commands.md."""
    # Every matrix here is small: threads inside the linear algebra only wait for one another.
    for library in LIBRARIES:
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    sys.argv[1:] = sorted(sys.argv[1:], key=lambda word: word != "--quiet")  # anywhere, for every command
    from kfgen.cli.app import app
    from kfgen.core.terminal import catch_signals, ending_of

    catch_signals()
    try:
        try:
            app()
        finally:
            sys.stdout.flush()
    except (Exception, KeyboardInterrupt) as error:
        status, message = ending_of(error)
        if isinstance(error, BrokenPipeError):  # nobody reads: what is left must not complain at the end
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if message:
            print(message, file=sys.stderr)
        sys.exit(status)
