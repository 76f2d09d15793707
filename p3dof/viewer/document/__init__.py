"""One page for the browser: a document with a machine, its runs and its forces, in one file of HTML.

`page_document` is all that a page shows of the manipulator, `robot_document` all of any robot; `Page` writes
it into one file, `save_glb` writes it as a scene for other tools. `studio_page` is another page: maps of a
machine's indices, and designs that are compared.
"""

from p3dof.viewer.document.document import page_document
from p3dof.viewer.document.glb import as_glb, save_glb
from p3dof.viewer.document.html import page_html
from p3dof.viewer.document.robots.document import robot_document
from p3dof.viewer.document.robots.figure import RobotFigure
from p3dof.viewer.document.saved import Page
from p3dof.viewer.document.studio import save_studio, studio_page

__all__ = [
    "Page",
    "RobotFigure",
    "as_glb",
    "page_document",
    "page_html",
    "robot_document",
    "save_glb",
    "save_studio",
    "studio_page",
]
