"""What a machine has to do, what drives it, and which one is better."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    [
        "assessment",
        "balance",
        "bearings",
        "best_path",
        "design_comparison",
        "drives",
        "fastest",
        "forces_of_tasks",
        "optimisation",
        "sizing",
        "sweeps",
        "task_limits",
        "task_loads",
        "tasks",
    ],
)
