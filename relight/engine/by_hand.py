"""The captured light of a scene as a hand may set it: what is offered, and where it is kept."""

import os
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import InputError

from ..albedo.by_hand import HandLight, HandScene, SkyAndSun, keep, offered_in
from ..albedo.captured import CapturedScene, CaptureEvidence
from ..albedo.seen import looks_from
from ..light.captured_light import NAME, LikelyLight, read_lights
from ..light.environment import Environment
from .appearance import CAPTURE, Appearance, sky_of
from .relighter import Relighter


def can_be_set(look: Appearance, relighter: Relighter) -> bool:
    """Whether the captured light of a scene with this Appearance can be set by hand: one light was estimated, or known,
    of one capture in the open."""
    one = len(relighter.scene.source.get("objects") or ()) <= 1
    found = look.prior is not None and look.environment is not None
    return one and found and look.room is None and not look.as_captured


class LightByHand:
    """Sets the captured light of one scene. offered: SkyAndSuns, the likeliest first; after them one set before."""

    def __init__(self, relighter: Relighter, look: Appearance) -> None:
        """look: the Appearance of the scene, whose light is offered where the folder of the scene offers none. Raises
        InputError for damaged offers."""
        self._relighter = relighter
        folder = relighter.scene.path
        self.folder = None if folder is None or not os.path.isdir(folder) else Path(folder)
        self.offered = [] if self.folder is None or not (self.folder / NAME).exists() else self._in_folder(self.folder)
        if not self.offered and look.environment is not None:
            self.offered = [SkyAndSun.of(LikelyLight("as estimated", 1.0, None, ""), look.environment)]

    @property
    def first(self) -> int:
        """Number, from 0, of the offered light to begin with: the one set before, or else the likeliest."""
        return len(self.offered) - 1 if self.offered[-1].entry.by_hand else 0

    @property
    def captured(self) -> NDArray[np.float32]:
        """(V, 3) float32 linear captured colours."""
        return self._relighter.scene.colors_linear

    def albedo(self, number: int, hand: HandLight, exact: bool = False) -> NDArray[np.float32]:
        """(V, 3) under an offered light changed by hand. exact: with the sun traced."""
        return self._known.albedo(self.offered[number], hand, exact)

    def under(self, environment: Environment) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Albedo and irradiance, (V, 3) each, under an Environment in the unit of the captured colours."""
        return self._known.under(environment)

    def keep(self, number: int, hand: HandLight) -> Path:
        """Write the light into the folder of the scene, as the one that commands use from now on: the path of the JSON.

        Raises InputError for a scene in memory, and for a folder that cannot be written.
        """
        if self.folder is None:
            raise InputError("the captured light is kept in the folder of a scene, and this scene has none: save it")
        keep(self.folder, self.offered[number], hand)
        return self.folder / NAME

    @staticmethod
    def _in_folder(folder: Path) -> list[SkyAndSun]:
        return offered_in(read_lights(folder / NAME), folder)

    @cached_property
    def _known(self) -> HandScene:
        relighter = self._relighter
        scene = relighter.scene
        known = relighter.transport(CAPTURE, alone=True)
        evidence = CaptureEvidence(sky_of(scene), looks_from(scene, relighter.occluder))
        asked = relighter.occluder, scene.colors_linear, relighter.seed, lambda count: None
        return HandScene(CapturedScene(*asked, known, evidence))
