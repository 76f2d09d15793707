"""`p3dof loop`: any robot with closed loops on the command line."""

from p3dof.cli.loop import assemble, codegen, export, forces, info, show, simulate

__all__ = ["assemble", "codegen", "export", "forces", "info", "show", "simulate"]
