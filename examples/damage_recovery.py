"""x"""
from __future__ import annotations

import sys

from aquafish.recovery.command import Recover
from aquafish_gym.utils.command_line import BAD_INPUT, run_command_line, single_command
from eea import ConfigurationError

if __name__ == "__main__":
    sys.exit(
        run_command_line(
            "damage_recovery", single_command(Recover), refused=(*BAD_INPUT, ConfigurationError)
        )
    )
