"""Pictures and films of the robot; PyBullet, which draws, is loaded when first used."""

from aquafish_gym.rendering.render import (
    RENDER_MODES,
    Window,
    check_render_mode,
    render_motion,
    render_pose,
    usable_modes,
    write_gif,
)
from aquafish_gym.rendering.scenery import Camera, Frame

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
