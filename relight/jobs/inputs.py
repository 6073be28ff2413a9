"""The inputs of a request that no light changes, read on first use: the scene, its source splats, added objects."""

import os
import warnings
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from splat2mesh.base.choices import check_choice
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.base.progress import Stages
from splat2mesh.scene.foreign import as_scene
from splat2mesh.scene.scene import Scene
from splat2mesh.scene.sources import source_splats
from splat2mesh.splats.splats import Splats

from ..insert.asked import AskedInsert, asked_inserts
from ..lamps.asked import AskedLamp
from ..lamps.spec import asked_lamps
from ..light import ANEW
from ..light.environment import Environment
from ..light.loading import light_of
from ..options import DEFAULT_TOLERANCE, PLACE_TOLERANCE, LightingOptions
from ..output.kinds import AROUND, DEFAULT_KINDS, FILES, OF_SPLATS, WITHOUT_LIGHT
from ..request import RelightRequest
from ..splats.lit_part import LitPart
from ..splats.parts import AskedPart
from .meshing import SceneAtHand


class Inputs:
    """The inputs of a RelightRequest. Each is read on first use.

    request: RelightRequest of one light. stages: Stages that time the work. at_hand: what was read of the scene before.
    Raises InputError, at that time, for input that cannot be read or used.
    """

    def __init__(
        self, request: RelightRequest, stages: Stages | None = None, at_hand: SceneAtHand | None = None
    ) -> None:
        self.request, self.stages, self._at_hand = request, stages or Stages(), at_hand

    @cached_property
    def environment(self) -> Environment:
        """The first light, not turned."""
        with self.stages.stage("environment"):
            return light_of(self.request.light)

    @cached_property
    def read_scene(self) -> Scene:
        """The scene as read; of an animation its first frame."""
        _ = (
            self.environment,
            self.asked_lamps,
            self.asked_inserts,
            self.asked_parts,
        )  # or an InputError, before any work
        if self._at_hand is not None:
            return self._at_hand.scene
        with self.stages.stage("load"):
            return self.animation.scene if self.plays else as_scene(self.request.scene)

    @property
    def plays(self) -> bool:
        """Whether the scene itself is an animation; with inserted objects, these are."""
        return self.request.animated and not self.request.inserted

    @cached_property
    def splats(self) -> tuple[Splats, list[Path]] | None:
        """The splats that the scene was made from and the paths of their files; None for a mesh, which has none.

        None with a DataWarning if they are missing and were not requested.
        """
        wanted = bool(set(OF_SPLATS) & set(self.request.formats or ()))
        asked = wanted or (self.of_splats and (bool(self.request.baked) or self.request.splat is not None))
        asked = asked or any(each.needs_splats for each in self.asked_parts)
        if not asked and "sha256" not in self.read_scene.source:
            return None
        with self.stages.stage("load"):
            known = self._at_hand.splats() if self._at_hand is not None and self.request.splat is None else None
            if known is not None:
                return known
            try:
                return source_splats(self.read_scene, self.request.splat)
            except InputError as error:
                if asked:
                    raise
                message = f"{error}; without it no splat is relit, and the picture shows the mesh"
                warnings.warn(message, DataWarning, stacklevel=2)
                return None

    @property
    def shown_splats(self) -> Splats | None:
        """The splats, as captured, where results show them; else None."""
        return self.splats[0] if self.shows_splats and self.splats is not None else None

    @property
    def splat_file(self) -> Path | None:
        """The file that these were read from, where it is one."""
        found = self.splats if self.shows_splats else None
        return found[1][0] if found is not None and len(found[1]) == 1 else None

    @cached_property
    def formats(self) -> tuple[str, ...]:
        """The outputs for each light, of `output.kinds.FILES`."""
        if self.request.formats is not None:
            for word in self.request.formats:
                check_choice("formats", word, tuple(FILES))
            return tuple(self.request.formats)
        return DEFAULT_KINDS if self.splats is None else (*DEFAULT_KINDS, "splat")

    @cached_property
    def options(self) -> LightingOptions:
        """The given options; without a tolerance, with the default for this kind of scene."""
        lighting = self.request.lighting
        if self.request.capture_env is not None:  # whatever was chosen in the folder of the scene
            lighting = replace(lighting, captured_light=ANEW)
        return lighting.planned(PLACE_TOLERANCE if self.read_scene.is_place else DEFAULT_TOLERANCE)

    @cached_property
    def asked_lamps(self) -> list[AskedLamp]:
        """The added lamps as requested."""
        return asked_lamps(self.request.lighting.placed)

    @cached_property
    def asked_inserts(self) -> list[AskedInsert]:
        """The inserted objects as requested."""
        return asked_inserts(self.request.inserted)

    @cached_property
    def asked_part(self) -> AskedPart | None:
        """The part that takes the new light or keeps the captured one, as requested; None for all in the new light."""
        return AskedPart.parse(self.request.only, self.request.keep)

    @cached_property
    def lit_parts(self) -> list[LitPart]:
        """The parts in lights of their own, as requested."""
        return [LitPart.parse(each) for each in self.request.parts]

    @property
    def asked_parts(self) -> list[AskedPart]:
        """All requested parts: that of `asked_part` where there is one, then the others."""
        first = [] if self.asked_part is None else [self.asked_part]
        return [*first, *(each.part for each in self.lit_parts)]

    @cached_property
    def animation(self) -> Any:
        """The Animation that the scene is a frame of."""
        from ..animation.animation import Animation

        return Animation(str(self.request.scene))

    @cached_property
    def of_splats(self) -> bool:
        """Whether the scene was made from a splat: a mesh's colours are its maker's albedo, a splat's are not."""
        return bool(self.read_scene.source) or (
            self.read_scene.path is not None and Path(self.read_scene.path).is_dir()
        )

    @property
    def choice(self) -> Any:
        """The source of the albedo."""
        if self.request.albedo is None and self.request.needs_no_light:
            return "captured"
        return ("estimated" if self.of_splats else "captured") if self.request.albedo is None else self.request.albedo

    @property
    def choice_name(self) -> str:
        """The source of the albedo, as the report names it."""
        return "array" if isinstance(self.choice, np.ndarray) else str(self.choice)

    @property
    def shows_splats_alone(self) -> bool:
        """Whether only the splats of a place are shown, so other vertices need no light."""
        alone = (
            not self.request.baked
            and self.request.formats is not None
            and set(self.request.formats) <= {"splat", "png", *AROUND, *WITHOUT_LIGHT}
        )
        return alone and not self.plays and self.read_scene.is_place and self.splats is not None

    @property
    def shows_splats(self) -> bool:
        """Whether any result needs the splats: pictures show them too."""
        baked, formats = self.request.baked, self.request.formats
        return bool(baked) or formats is None or not {*OF_SPLATS, "png"}.isdisjoint(formats)

    @property
    def name(self) -> str:
        """The scene as the report names it."""
        given = self.request.scene
        if isinstance(given, (str, os.PathLike)):
            return str(Path(given))
        return str(self.read_scene.path or self.read_scene.source.get("file", "a mesh in memory"))
