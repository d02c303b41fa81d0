"""Where ``ps4rig`` and ``python -m capture`` begin."""

from __future__ import annotations

import sys

__all__ = ["main"]


def main() -> None:
    """Run the command line. Ctrl-C is one line, also while Python still loads it."""
    try:
        from .cli import run
        from .process_settings import settle_process

        settle_process()
        status = run()
    except KeyboardInterrupt:
        print("ps4rig: interrupted", file=sys.stderr)
        status = 130
    sys.exit(status)


if __name__ == "__main__":
    main()
