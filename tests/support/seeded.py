"""Settings of the property tests: the same examples on every run, and few enough for the suite."""

from hypothesis import HealthCheck, settings

bounded = settings(
    max_examples=25, deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck)
)
"""Seconds in all, whatever machine; nothing is kept between runs."""
