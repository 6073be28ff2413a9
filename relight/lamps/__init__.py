"""Lamps that people place: their shapes, how they are asked for, and the light that they throw on a scene."""
