"""Gaussian splats as arrays, moved and joined; `Splats.load` and `Splats.save` go to `formats`."""

from . import formats
from .splats import Splats

Splats.files = formats
