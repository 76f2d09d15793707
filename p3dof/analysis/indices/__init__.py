"""Performance indices at poses and over workspaces: how well a machine moves, holds and withstands."""

from p3dof.analysis.indices.datasets import write_dataset
from p3dof.analysis.indices.definitions import COLUMNS, DEFINITIONS, Definition
from p3dof.analysis.indices.elasticity import DRIVE
from p3dof.analysis.indices.results import STEEL_RODS, Indices, Machine, check_names, columns_of
from p3dof.analysis.indices.tables import indices_table

__all__ = [
    "COLUMNS",
    "DEFINITIONS",
    "DRIVE",
    "STEEL_RODS",
    "Definition",
    "Indices",
    "Machine",
    "check_names",
    "columns_of",
    "indices_table",
    "write_dataset",
]
