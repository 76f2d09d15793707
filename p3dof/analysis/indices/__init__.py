"""Performance indices at poses and over workspaces: how well a machine moves, holds and withstands."""

from p3dof.analysis.indices.definitions import (
    COLUMNS,
    DEFINITIONS,
    DRIVE,
    STEEL_RODS,
    Definition,
    Indices,
    IndicesMachine,
    check_names,
    columns_of,
    indices_table,
    write_dataset,
)

__all__ = [
    "COLUMNS",
    "DEFINITIONS",
    "DRIVE",
    "STEEL_RODS",
    "Definition",
    "Indices",
    "IndicesMachine",
    "check_names",
    "columns_of",
    "indices_table",
    "write_dataset",
]
