"""The command line: the only place that prints."""

from __future__ import annotations

import os
import sys

LIBRARIES = ("OPENBLAS", "OMP", "MKL", "VECLIB_MAXIMUM")


def main() -> None:
    """Run the command line; the exit status is 0, 1 for a failed check, 2 for bad input."""
    # Every matrix here is small: threads inside the linear algebra only wait for one another.
    for library in LIBRARIES:
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    from kfgen.cli.app import app
    from kfgen.core.errors import KfgenError

    try:
        app()
    except KfgenError as error:
        print(f"kfgen: {error}", file=sys.stderr)
        sys.exit(error.exit_status)
    except (BrokenPipeError, KeyboardInterrupt):
        sys.exit(130)
    except (OSError, MemoryError) as error:
        print(f"kfgen: {error or 'out of memory'}", file=sys.stderr)
        sys.exit(2)
