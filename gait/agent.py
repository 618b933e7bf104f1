"""Controllers as agents; the code is in :mod:`gait.controllers.agent`."""

from gait.controllers.agent import ControllerAgent

__all__ = ["ControllerAgent"]
