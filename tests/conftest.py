"""Settings that all tests share."""

from hypothesis import HealthCheck, settings

# A fixed seed (derandomize) makes a failure repeatable; time limits belong to benchmarks.
settings.register_profile(
    "p3dof", derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("p3dof")
