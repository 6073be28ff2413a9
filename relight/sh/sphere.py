"""Directions that share the sphere evenly."""

from splat2mesh.base.sphere import fibonacci_sphere

__all__ = ["fibonacci_sphere"]
