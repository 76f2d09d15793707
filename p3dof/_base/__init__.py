"""What all doors stand on: errors, checks, files, tables, algebra, work in blocks."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, ["blocks"])
