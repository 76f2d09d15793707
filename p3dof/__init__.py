"""p3dof."""
