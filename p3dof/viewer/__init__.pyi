# What `p3dof.viewer` offers; each name is imported when it is first used.

# The paper's machine
from .machine.document import page_document
from .machine.room import joints_of, trace_of
from .machine.scene import ArrowScale, Scene, viewer
from .machine.showing import page, show
from .machine.studio import save_studio, studio_page

# Any robot
from .document.document import robot_document
from .document.figure import RobotFigure
from .document.motion import JointMotion
from .robot_scene import robot_viewer
from .showing import robot_page, show_robot

# Documents and pages, of both
from .document.encoding import decoded
from .document.glb import as_glb, save_glb
from .document.html import Page, page_html
from .live_viewer import LiveViewer
from .pictures import save_screenshot, save_video
from .window import SceneWindow

__all__ = [
    "ArrowScale",
    "JointMotion",
    "LiveViewer",
    "Page",
    "RobotFigure",
    "Scene",
    "SceneWindow",
    "as_glb",
    "decoded",
    "joints_of",
    "page",
    "page_document",
    "page_html",
    "robot_document",
    "robot_page",
    "robot_viewer",
    "save_glb",
    "save_screenshot",
    "save_studio",
    "save_video",
    "show",
    "show_robot",
    "studio_page",
    "trace_of",
    "viewer",
]
