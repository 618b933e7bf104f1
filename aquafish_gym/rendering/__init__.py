"""Pictures and films of the robot."""

from aquafish_gym.rendering.camera import Camera, Frame
from aquafish_gym.rendering.course import FilmedSwim
from aquafish_gym.rendering.films import film
from aquafish_gym.rendering.render import render_pose
from aquafish_gym.rendering.window import RENDER_MODES, Window, check_render_mode, usable_modes

__all__ = [
    "RENDER_MODES",
    "Camera",
    "FilmedSwim",
    "Frame",
    "Window",
    "check_render_mode",
    "film",
    "render_pose",
    "usable_modes",
]
