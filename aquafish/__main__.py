"""``python -m aquafish``, the same as the command ``aquafish``."""

import sys

from aquafish.cli import main

if __name__ == "__main__":
    sys.exit(main())
