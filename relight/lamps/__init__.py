"""Placed lamps: their shapes, the text that requests them, and their light on a scene."""
