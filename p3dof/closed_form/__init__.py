"""The first way to the forces: the paper's equations, on scalars, over arrays, and compiled."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    [
        "compiled",
        "kinematics",
        "paper",
    ],
)
