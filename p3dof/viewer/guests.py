"""What MeshCat draws as a guest of the page: its packed commands go to the pages, also to later ones."""

from __future__ import annotations

from typing import Any

from p3dof._base.errors import MissingExtraError
from p3dof.viewer.server import subject_of
from p3dof.viewer.session import Session
from p3dof.viewer.window import SceneWindow


def guest_of(session: Session, window: SceneWindow | None = None) -> Any:
    """Return a visualizer whose drawings appear in the pages of a session.

    Parameters
    ----------
    session : Session
        Whose pages.
    window : SceneWindow, optional
        Another's, such as that of `p3dof.viewer.viewer`: all that is drawn there appears too.

    Returns
    -------
    meshcat.Visualizer

    Raises
    ------
    MissingExtraError
        If MeshCat is not installed.
    """
    shown = SceneWindow() if window is None else window
    try:
        import meshcat
    except ImportError as error:
        raise MissingExtraError("guests need meshcat: pip install 'p3dof[viz]'") from error
    draw = session.draw_guests(shown.messages)
    shown.subscribe(lambda command: draw(command, subject_of(command)))
    return meshcat.Visualizer(window=shown)
