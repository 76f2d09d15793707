"""XML formats of robots: text that all writers share, and what is known of MJCF and SDF."""

from p3dof._base.markup.text import document, moments, numbers, roll_pitch_yaw, sub

__all__ = ["document", "moments", "numbers", "roll_pitch_yaw", "sub"]
