"""What the libraries need before a file of tests begins."""

import os

import pytest


@pytest.fixture(scope="module")
def warp_cache(tmp_path_factory):
    """Kernels of Warp are compiled into a folder that the workers of this run share, for a processor."""
    import warp as wp

    base = tmp_path_factory.getbasetemp()
    base = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    before = wp.config.kernel_cache_dir
    wp.config.kernel_cache_dir = str(base / "warp")
    with wp.ScopedDevice("cpu"):
        yield
    wp.config.kernel_cache_dir = before
