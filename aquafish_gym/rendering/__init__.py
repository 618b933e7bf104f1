"""Pictures and films of the robot."""

from aquafish_gym.rendering.camera import Camera, Frame
from aquafish_gym.rendering.films import FilmedSwim, Stage, film, write_film, write_gif
from aquafish_gym.rendering.render import render_motion, render_pose
from aquafish_gym.rendering.window import RENDER_MODES, Window, check_render_mode, usable_modes

__all__ = [
    "RENDER_MODES",
    "Camera",
    "FilmedSwim",
    "Frame",
    "Stage",
    "Window",
    "check_render_mode",
    "film",
    "render_motion",
    "render_pose",
    "usable_modes",
    "write_film",
    "write_gif",
]
