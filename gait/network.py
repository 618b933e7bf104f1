"""What a controller's network senses; the code is in :mod:`gait.controllers.network`."""

from gait.controllers.network import Senses
from gait.controllers.network import put_inputs as observe

__all__ = ["Senses", "observe"]
