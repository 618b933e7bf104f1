"""Controllers; the code is in :mod:`gait.controllers.controller`."""

from gait.controllers.controller import Controller

__all__ = ["Controller"]
