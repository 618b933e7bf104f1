"""``python -m gait evolve``, ``transfer`` and ``baseline``: see ``gait.cli``."""

import sys

if __name__ == "__main__":
    try:
        from gait.cli import main

        sys.exit(main())
    except KeyboardInterrupt:  # while importing
        print("gait: interrupted", file=sys.stderr)
        sys.exit(130)
