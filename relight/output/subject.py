"""What all writers of results take: the scene, the files to write, and a folder for those of one light."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Radiance, Vector
from splat2mesh.base.progress import Stages
from splat2mesh.render.view import View
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import Splats

from ..live.parts import LivePart
from ..splats.parts import PartShares, blended
from .lamps_glb import NO_LAMPS, PlacedLamps

if TYPE_CHECKING:
    from ..engine.appearance import Appearance
    from ..engine.light_mix import LightMix
    from ..engine.placed import LampLight
    from ..engine.relighter import Relighter, Shaded
    from ..gloss import SceneGloss
    from ..insert.probe import LightAround, ProbeGrid
    from ..light.environment import Environment
    from ..splats.floor_mirror import FloorMirror
    from ..texture import Baked

LightParts = Mapping[str, NDArray[np.float32]]
"""Name of a path of light -> what vertices send out by it, (V, 3)."""


@dataclass(frozen=True)
class AskedFiles:
    """The results to write, as of a request. kinds: words of `kinds.FILES`; `lights` are loaded."""

    kinds: Sequence[str]
    baked: Sequence[str] = ()
    texture_size: int | None = None
    live_mesh: bool = False
    harmonics: str = "zero"
    lights: "Sequence[Environment]" = ()
    probe_at: Sequence[Vector] = ()
    probe_grid: "ProbeGrid | None" = None
    color_space: str = "srgb"
    tolerance: float | None = None
    sky: str = "new"
    seed: int = 0


class PartInLight(NamedTuple):
    """A part in a light of its own. shares: of that light. under: returns it, as it lights the whole scene, beside the
    light of the rest; in it `received` is known."""

    shares: PartShares
    under: "Callable[[Shaded], Shaded]"


@dataclass(frozen=True, eq=False)
class WrittenScene:
    """A scene, its source, the light on it beside an environment, and what is asked for.

    splats: (Splats, paths of their files), None where no result needs them. binding: returns the Binding of the splats;
    called where splats are. lamps: function of a light and its exposure: what was added to it. gloss: None where gloss
    stays as captured. mix: all light. lamp_light: returns the LampLight of lamps beside every light, or None. mirror:
    returns the FloorMirror of the splats, or None. texture: returns the Baked texture of mesh.glb, or None; made when
    it is needed without. light_around: returns the LightAround of one of the lights. light_parts: of one of them, what
    vertices send out by the way that its light came: those but `kinds.SUN`, which is a part of another, are all of it.
    pass_views: returns the cameras of passes, frame of the scene; None is that of the preview. part: what takes the new
    light; None for all. part_shadow: of one of the lights, by what it changes the light of the rest, (V, 3); None where
    the rest stays. lit_parts: parts in lights of their own, the last one on top. kept_parts:
    returns those that the folder of the scene keeps.
    """

    relighter: "Relighter"
    appearance: "Appearance"
    asked: AskedFiles
    splats: tuple[Splats, list[Path]] | None = None
    binding: Callable[[], Any] = lambda: None
    lamps: Callable[["Environment", float], PlacedLamps] = lambda light, exposure: NO_LAMPS
    gloss: "SceneGloss | None" = None
    mix: "LightMix | None" = None
    lamp_light: "Callable[[], LampLight | None]" = lambda: None
    mirror: Callable[[], "FloorMirror | None"] = lambda: None
    texture: Callable[[], "Baked | None"] | None = None
    light_around: "Callable[[Shaded], LightAround] | None" = None
    light_parts: "Callable[[Shaded], LightParts] | None" = None
    pass_views: Callable[[], Sequence[View] | None] = lambda: None
    part: PartShares | None = None
    part_shadow: "Callable[[Shaded], NDArray[np.float32]] | None" = None
    lit_parts: Sequence[PartInLight] = ()
    kept_parts: Callable[[], Sequence[LivePart]] = tuple

    def shown(self, shaded: "Shaded") -> "Shaded":
        """The light as the mesh shows it: that of each part, new in the part that takes it, captured in the rest."""
        found = self._where_new(shaded)
        for part in self.lit_parts:
            own, shares, shading = part.under(shaded), part.shares.vertices, found.shading
            assert own.shading.received is not None  # as of a PartInLight
            level, received = np.float32(own.exposure / shaded.exposure), shading.received
            if received is None:
                received = self.appearance.received(shading.radiance, shaded.exposure)
            radiance = blended(shading.radiance, level * own.shading.radiance, shares)
            received = blended(received, level * own.shading.received, shares)
            found = found._replace(shading=shading._replace(radiance=radiance, received=received))
        return found

    def _where_new(self, shaded: "Shaded") -> "Shaded":
        if self.part is None:
            return shaded
        look, shading, shares = self.appearance, shaded.shading, self.part.vertices
        received = shading.received
        if received is None:
            received = look.received(shading.radiance, shaded.exposure)
        shade = np.float32(1.0) if self.part_shadow is None else self.part_shadow(shaded)
        captured, before = (each * shade / shaded.exposure for each in (look.captured, look.irradiance))
        radiance, received = blended(captured, shading.radiance, shares), blended(before, received, shares)
        return shaded._replace(shading=shading._replace(radiance=radiance, received=received))

    @property
    def scene(self) -> Scene:
        """The scene."""
        return self.relighter.scene

    @property
    def stages(self) -> Stages:
        """What times the work."""
        return self.relighter.stages

    @property
    def source(self) -> Splats | None:
        """The splats, as captured."""
        return None if self.splats is None else self.splats[0]

    @property
    def source_file(self) -> Path | None:
        """The file that they were read from, where it is one."""
        return None if self.splats is None or len(self.splats[1]) != 1 else self.splats[1][0]

    @property
    def albedo(self) -> Radiance:
        """(V, 3) linear, white where it is that."""
        look = self.appearance
        return np.ones_like(look.captured) if look.albedo is None else look.albedo


@dataclass(frozen=True, eq=False)
class LitFolder:
    """A folder that exists, for the results of one light. relit: the splats in it, where a result needs them. facts:
    further entries of the report, to which writers add."""

    path: Path
    shaded: "Shaded"
    relit: Splats | None = None
    facts: dict[str, Any] = field(default_factory=dict)


class FileWriter(Protocol):
    """Writes kinds with files of their own, light after light."""

    def write(self, into: LitFolder) -> list[str]:
        """Write them; returns the names of the files."""
