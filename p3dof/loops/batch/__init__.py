"""Many samples at once: the twins of what `p3dof.loops` does for one."""
