"""What the paper's machine is (parameters), does (motion), and how other programs read it (description)."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    [
        "description",
        "motion",
        "parameters",
    ],
)
