"""The light of the capture as a light to request: it stays, and lamps are added to it."""

import numpy as np

from . import CAPTURED
from .environment import Environment


class CapturedLight(Environment):
    """Light as it was captured: no environment at all, so that nothing of it can be looked up, turned or scaled."""

    def __init__(self) -> None:
        super().__init__(np.zeros((2, 4, 3), np.float32), CAPTURED)
