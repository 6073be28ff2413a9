"""Splats seen by a camera: colour, opacity, and depth at a level of the opacity field."""
