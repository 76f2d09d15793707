"""What all doors stand on: errors, checks, files, tables, algebra, work in blocks."""

from typing import Any

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, ["blocks", "errors", "model_files"])


def attach(package: str, file: str) -> tuple[Any, Any, Any]:
    """Return what imports the names of a door when they are first used, and suggests one for a wrong one."""
    found, names, public = lazy_loader.attach_stub(package, file)

    def get(name: str) -> Any:
        try:
            return found(name)
        except AttributeError:
            if name in public:
                raise
        import difflib

        near = [] if name.startswith("_") else difflib.get_close_matches(name, public, 1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise AttributeError(f"module {package!r} has no attribute {name!r}{hint}")

    return get, names, public
