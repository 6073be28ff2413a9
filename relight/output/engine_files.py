"""Write files for engines: the mesh with live light, the splat as albedo with its proxy, splats as glTF and USD."""

import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.splats.splats import Splats

from ..light.captured import CapturedLight
from .kinds import FILES, FOR_ENGINES, HARMONICS
from .lamps_glb import PlacedLamps
from .subject import WrittenScene

if TYPE_CHECKING:
    from ..light.environment import Environment

PROXY, COLLISION = "proxy.glb", "albedo_splat.collision.glb"


class EngineFiles:
    """Writes those of `kinds` that are of `kinds.FOR_ENGINES`, and live.glb where `live_mesh` says so.

    harmonics: of `kinds.HARMONICS`, what becomes of an albedo splat's colour that depends on the view.
    Raises InputError for another word.
    """

    def __init__(
        self, written: WrittenScene, kinds: Sequence[str], live_mesh: bool = False, harmonics: str = "zero"
    ) -> None:
        if harmonics not in HARMONICS:
            raise InputError(f"`harmonics` {harmonics!r}: expected one of {', '.join(HARMONICS)}")
        self._relighter, self._appearance, self._live_mesh = written.relighter, written.appearance, live_mesh
        self._kinds = [kind for kind in FOR_ENGINES if kind in kinds]
        self._splats: Splats | None
        self._splats, self._paths = written.splats or (None, [])
        self._harmonics, self._sky, self._lamps, self._gloss = harmonics, written.sky, written.lamps, written.gloss
        self._mirror = written.mirror
        self._scene, self._stages = self._relighter.scene, self._relighter.stages
        self._nine: Any = None
        self._bare: Any = None

    @property
    def wants_relit(self) -> bool:
        """Whether `write` needs the splats in the new light."""
        return bool({"splat-glb", "usd"} & {*self._kinds})

    def write(
        self,
        folder: Path,
        light: "Environment",
        exposure: float,  # display value per unit of radiance
        relit: Splats | None,  # the splats in that light, where they are wanted
        bound: Callable[[], Any],  # the Binding of the splats
        scale: float = 1.0,  # on the light itself
    ) -> list[str]:
        """Fill a folder that exists with the files of one light; returns their names."""
        placed = self._lamps(light, exposure)
        names: list[str] = self._write_live(folder, light, exposure * scale, placed) if self._live_mesh else []
        if "albedo-splat" in self._kinds:
            names += self._write_albedo(folder, bound)
        if relit is None:
            return names
        with self._stages.stage("write"):
            if "splat-glb" in self._kinds:
                from .splat_glb import write_splat_glb

                extras = {"environment": light.name, "angle_deg": light.rotation_deg, "exposure": exposure}
                write_splat_glb(folder / FILES["splat-glb"], relit, self._scene.scene_from_splat, extras)
                names.append(FILES["splat-glb"])
            if "usd" in self._kinds:
                from .usd import write_usd

                looks = {"relit": relit}
                if "albedo-splat" in self._kinds:
                    looks["albedo"] = self._albedo(bound)[0]
                names += write_usd(
                    folder, looks, self._scene, self._surface, light, exposure * scale, placed, self._shine
                )
        return names

    @property
    def _surface(self) -> NDArray[np.float32]:
        """(V, 3) linear albedo, white where it is that."""
        look = self._appearance
        return np.ones_like(look.captured) if look.albedo is None else look.albedo

    @property
    def _shine(self) -> NDArray[np.float32] | None:
        """(V, 2) roughness and metalness; None without gloss."""
        return None if self._gloss is None else self._gloss.roughness(self._appearance)

    def _write_live(self, folder: Path, light: "Environment", exposure: float, placed: PlacedLamps) -> list[str]:
        from ..engine.nine import nine_coefficients
        from .live_glb import FILE, write_live_glb

        if placed.lamps or isinstance(light, CapturedLight):
            message = (
                "live.glb shows the light of an environment alone, neither captured light nor placed lamps on its mesh"
            )
            warnings.warn(f"{message}; lamps are in the file as lights, for other objects", DataWarning, stacklevel=2)
        if self._nine is None:
            with self._stages.stage("live mesh"):
                self._nine = nine_coefficients(self._relighter, self._appearance.albedo)
        with self._stages.stage("write"):
            write_live_glb(folder / FILE, self._scene, self._surface, self._nine, light, exposure, placed, self._shine)
        return [FILE]

    def _albedo(self, bound: Callable[[], Any]) -> tuple[Splats, NDArray[np.float32]]:
        """The splats with the light of the capture removed, and their normals (N, 3)."""
        from ..splats import albedo_splats, normals_of, shown_as_sky

        if self._bare is None:
            assert self._splats is not None  # no kind that needs them gets here without
            binding, mirror = bound(), self._mirror()
            rows = shown_as_sky(self._splats, self._scene, self._appearance, mirror)
            with self._stages.stage("albedo splats"):
                sky = "keep" if self._sky == "keep" else "drop"
                used = None if self._appearance.as_captured else binding
                bare = albedo_splats(self._splats, used, self._appearance, rows, self._harmonics, sky)
                self._bare = bare, normals_of(binding)
        return cast(tuple[Splats, NDArray[np.float32]], self._bare)

    def _write_albedo(self, folder: Path, bound: Callable[[], Any]) -> list[str]:
        """The splats as albedo, and the mesh in their frame and in that of PlayCanvas."""
        from ..splats import write_relit_ply
        from .proxy import PLAYCANVAS_FROM_SPLAT, write_proxy_glb

        splats, normals = self._albedo(bound)
        back = np.asarray(np.linalg.inv(self._scene.scene_from_splat), np.float64)
        with self._stages.stage("write"):
            source = self._paths[0] if len(self._paths) == 1 else None
            write_relit_ply(folder / FILES["albedo-splat"], splats, source, normals)
            write_proxy_glb(folder / PROXY, self._scene, back, self._surface, self._shine)
            write_proxy_glb(folder / COLLISION, self._scene, PLAYCANVAS_FROM_SPLAT @ back)
        return [FILES["albedo-splat"], PROXY, COLLISION]
