"""Names in files: those that are there stay, new ones are not used yet."""

from __future__ import annotations

import re
from collections.abc import Iterable

from p3dof._base.checks import shown
from p3dof._base.errors import ModelError

_NO_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


class Names:
    """The names of one scope.

    Parameters
    ----------
    target : str
        What is written, for errors.
    taken : iterable of str
        Names that are there.
    """

    def __init__(self, target: str, taken: Iterable[str] = ()) -> None:
        self._target, self._taken = target, set(taken)

    def own(self, name: str) -> str:
        """Enter a name of the robot and return it.

        Raises
        ------
        ModelError
            If it cannot be written, or is there already.
        """
        if not name or _NO_XML.search(name):
            raise ModelError(f"{self._target}: the name {shown(name)} cannot be written in XML")
        if name in self._taken:
            raise ModelError(f"{self._target}: the name {shown(name)} is there twice")
        self._taken.add(name)
        return name

    def new(self, name: str) -> str:
        """Return a name that is not used yet, one that is given if possible."""
        name = _NO_XML.sub("_", name) or "_"
        while name in self._taken:
            name += "_"
        self._taken.add(name)
        return name
