"""Many samples at once: the twins of what `p3dof.closed_loop` does for one."""
