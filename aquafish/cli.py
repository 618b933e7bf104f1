"""The command ``aquafish``: the case study, and every command of ``eea`` and of ``gait``."""

from __future__ import annotations

import sys
from collections.abc import Sequence

VIEW = ("aquafish.viewer.command:View", "watch robots swim, and break them in mid-swim")
PAGE = ("aquafish.page.command:Page", "write a page in which the fish swims, to break its fins")
CASE_STUDY = ("aquafish.recovery.command:CaseStudy", "the case study: damage, self-model, gait")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code, see ``run_command_line``."""
    from aquafish_gym.utils.validation import MissingExtraError

    try:  # imported here, so that Ctrl-C is answered from the start
        from aquafish_gym.runs.command_line import end_at_signals, run_command_line

        with end_at_signals("aquafish"):
            from eea.__main__ import COMMANDS, REFUSED_ERRORS
            from gait.__main__ import COMMANDS as GAIT_COMMANDS
    except KeyboardInterrupt:
        print("aquafish: interrupted", file=sys.stderr)
        return 130
    except MissingExtraError as error:
        print(f"aquafish: {error}", file=sys.stderr)
        return 2
    commands = {"recover": CASE_STUDY, "view": VIEW, "page": PAGE, **COMMANDS, **GAIT_COMMANDS}
    return run_command_line("aquafish", commands, arguments, REFUSED_ERRORS)
