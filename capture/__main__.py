"""The start of ``ps4rig`` and ``python -m capture``."""

import os
import sys

from .base.interrupts import INTERRUPTED_LINE, INTERRUPTED_STATUS, install_handlers


def main() -> None:
    """Run the command line and end the process with its exit status."""
    # Before everything else, because the imports below take most of the start-up time.
    install_handlers()
    if not os.environ.get("COLUMNS", "1").strip("0"):
        del os.environ["COLUMNS"]  # rich would print nothing at a width of 0
    from .base.process_end import StandardStreams, log_threads, report_crash

    streams = StandardStreams()
    log_threads()
    try:
        from .cli import run

        status = run()
    except KeyboardInterrupt:
        status = INTERRUPTED_STATUS
    except Exception as error:
        status = report_crash(error)
    if status == INTERRUPTED_STATUS:
        print(INTERRUPTED_LINE, file=sys.stderr)
    sys.exit(streams.final_status(status))


if __name__ == "__main__":
    main()
