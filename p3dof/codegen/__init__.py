"""Generated C: the batch kernels of the package."""
