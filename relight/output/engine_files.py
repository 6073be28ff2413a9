"""Write files for engines: the mesh with live light, the splat as albedo with its proxy, splats as glTF and USD."""

import warnings
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import DataWarning
from splat2mesh.splats.splats import Splats

from ..engine.nine import nine_coefficients
from ..light.loading import CapturedLight
from ..splats import albedo_splats, normals_of, shown_as_sky, write_relit_ply
from .kinds import FILES
from .lamps_glb import ShownLight
from .live_glb import FILE, write_live_glb
from .proxy import PLAYCANVAS_FROM_SPLAT, write_proxy_glb
from .splat_glb import write_splat_glb
from .subject import LitFolder, WrittenScene

PROXY, COLLISION = "proxy.glb", "albedo_splat.collision.glb"


class EngineFiles:
    """Writes results that engines read, and live.glb where it is asked for."""

    def __init__(self, written: WrittenScene, _: object) -> None:
        self._written = written
        self._nine: Any = None
        self._bare: Any = None

    def write(self, into: LitFolder) -> list[str]:
        """Write the files of one light; returns their names."""
        written, shaded, kinds = self._written, into.shaded, self._written.asked.kinds
        light, exposure = shaded.light, shaded.exposure
        lit = ShownLight(light, exposure * shaded.backdrop, written.lamps(light, exposure))
        names: list[str] = self._write_live(into.path, lit) if written.asked.live_mesh else []
        if "albedo-splat" in kinds:
            names += self._write_albedo(into.path)
        if into.relit is None:
            return names
        with written.stages.stage("write"):
            if "splat-glb" in kinds:
                extras = {"environment": light.name, "angle_deg": light.rotation_deg, "exposure": exposure}
                write_splat_glb(into.path / FILES["splat-glb"], into.relit, written.scene.scene_from_splat, extras)
                names.append(FILES["splat-glb"])
            if "usd" in kinds:
                from .usd import write_usd

                looks = {"relit": into.relit}
                if "albedo-splat" in kinds:
                    looks["albedo"] = self._albedo()[0]
                names += write_usd(into.path, looks, written.scene, written.albedo, lit, self._shine)
        return names

    @property
    def _shine(self) -> NDArray[np.float32] | None:
        """(V,) roughness; None without gloss."""
        gloss = self._written.gloss
        return None if gloss is None else gloss.roughness(self._written.appearance)

    def _write_live(self, folder: Path, lit: ShownLight) -> list[str]:
        if lit.placed.lamps or isinstance(lit.light, CapturedLight):
            message = (
                "live.glb shows the light of an environment alone, neither captured light nor placed lamps on its mesh"
            )
            warnings.warn(f"{message}; lamps are in the file as lights, for other objects", DataWarning, stacklevel=2)
        if self._nine is None:
            with self._written.stages.stage("live mesh"):
                self._nine = nine_coefficients(self._written.relighter, self._written.appearance.albedo)
        with self._written.stages.stage("write"):
            write_live_glb(folder / FILE, self._written.scene, self._written.albedo, self._nine, lit, self._shine)
        return [FILE]

    def _albedo(self) -> tuple[Splats, NDArray[np.float32]]:
        """The splats with the light of the capture removed, and their normals (N, 3)."""
        if self._bare is None:
            written, splats, look = self._written, self._written.source, self._written.appearance
            assert splats is not None  # no kind that needs them gets here without
            binding, mirror = written.binding(), written.mirror()
            rows = shown_as_sky(splats, written.scene, look, mirror)
            with self._written.stages.stage("albedo splats"):
                sky = "keep" if written.asked.sky == "keep" else "drop"
                used = None if look.as_captured else binding
                bare = albedo_splats(splats, used, look, rows, written.asked.harmonics, sky)
                self._bare = bare, normals_of(binding)
        return cast(tuple[Splats, NDArray[np.float32]], self._bare)

    def _write_albedo(self, folder: Path) -> list[str]:
        """The splats as albedo, and the mesh in their frame and in that of PlayCanvas."""
        splats, normals = self._albedo()
        back = np.asarray(np.linalg.inv(self._written.scene.scene_from_splat), np.float64)
        with self._written.stages.stage("write"):
            write_relit_ply(folder / FILES["albedo-splat"], splats, self._written.source_file, normals)
            write_proxy_glb(folder / PROXY, self._written.scene, back, self._written.albedo, self._shine)
            write_proxy_glb(folder / COLLISION, self._written.scene, PLAYCANVAS_FROM_SPLAT @ back)
        return [FILES["albedo-splat"], PROXY, COLLISION]
