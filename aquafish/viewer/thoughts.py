"""What a self-model knows, in words for the page."""

from __future__ import annotations

import numpy as np

from aquafish.online import SelfModelAgent
from aquafish.online.self_model import ATTITUDE_ERRORS, FIN_ERRORS, VELOCITY_ERRORS
from aquafish.viewer.door import as_code
from aquafish_gym.rendering.scene import CM_PER_UNIT


def words_about(agent: SelfModelAgent | None, calibrates_for: float) -> str:
    """Return Markdown about an agent's uncertainty, what it recognised, and its last events.

    It measures its own error for ``calibrates_for`` s more.
    """
    if agent is None:
        return "choose one robot and 'self-model' to see its estimate"
    sd = np.sqrt(np.diag(agent.model.covariance))
    attitude, fins = np.degrees([sd[ATTITUDE_ERRORS].max(), sd[FIN_ERRORS].max()])
    lines = [
        f"± {attitude:.2g}° attitude, ± {fins:.2g}° fins, "
        f"± {CM_PER_UNIT * sd[VELOCITY_ERRORS].max():.2g} cm/s (1 sd)"
    ]
    if calibrates_for > 0:
        lines.append(f"measures its own error for {calibrates_for:.0f} s more")
    if agent.recognised is not None:
        several = agent.recognised.alternatives[:3]
        lines += [
            f"{one.weight:.0%} {as_code(one.damage.said())}"
            for one in several
            if one.weight > 0.005
        ]
    lines += [
        as_code(f"{e.seconds:.1f} s {e.what}: {e.about}") for e in reversed(agent.events[-6:])
    ]
    return "\n\n".join(lines)
