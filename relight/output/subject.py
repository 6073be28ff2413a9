"""The scene of the results, in the form that every writer takes."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from splat2mesh.splats.splats import Splats

from .lamps_glb import NO_LAMPS, PlacedLamps

if TYPE_CHECKING:
    from ..engine.appearance import Appearance
    from ..engine.placed import LampLight
    from ..engine.relighter import Relighter
    from ..gloss import SceneGloss
    from ..light.environment import Environment
    from ..splats.floor_mirror import FloorMirror
    from ..texture import Baked


@dataclass(frozen=True, eq=False)
class WrittenScene:
    """A scene, its source, and the light on it beside an environment.

    splats: (Splats, paths of their files), None where no result needs them. binding: returns the Binding of the splats;
    called where splats are. sky: of `splats.SKIES`, for the far background of splats; "keep" keeps that of an albedo
    splat as captured, else it is hidden. seed: of all that is sampled. lamps: function of a light and its exposure:
    what was added to it. gloss: None where gloss stays as captured. lamp_light: returns
    the LampLight of lamps beside every light, or None. mirror: returns the FloorMirror of the splats, or
    None. texture: returns the Baked texture of mesh.glb, or None; made when it is needed without.
    """

    relighter: "Relighter"
    appearance: "Appearance"
    splats: tuple[Splats, list[Path]] | None = None
    binding: Callable[[], Any] = lambda: None
    sky: str = "new"
    seed: int = 0
    lamps: Callable[["Environment", float], PlacedLamps] = lambda light, exposure: NO_LAMPS
    gloss: "SceneGloss | None" = None
    lamp_light: "Callable[[], LampLight | None]" = lambda: None
    mirror: Callable[[], "FloorMirror | None"] = lambda: None
    texture: Callable[[], "Baked | None"] | None = None
