"""Pictures and films of the robot."""

from aquafish_gym.rendering.camera import Camera, Frame
from aquafish_gym.rendering.render import render_motion, render_pose, write_gif
from aquafish_gym.rendering.window import RENDER_MODES, Window, check_render_mode, usable_modes

__all__ = [
    "RENDER_MODES",
    "Camera",
    "Frame",
    "Window",
    "check_render_mode",
    "render_motion",
    "render_pose",
    "usable_modes",
    "write_gif",
]
