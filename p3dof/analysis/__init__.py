"""What acts in a machine, where it can work and how well, also when it is not what its drawings say."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    [
        "designs",
        "energy",
        "indices",
        "load_friction",
        "reactions",
        "sampling",
        "tolerances",
        "workspace",
    ],
)
