"""Write the files of one light after another: meshes, splats, textures, a picture. Shared parts are made once."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.splats.formats import WRITERS, kind_of, write_splats
from splat2mesh.splats.splats import Splats

from . import mesh_files
from .kinds import FILES

if TYPE_CHECKING:
    from ..engine.appearance import Appearance
    from ..engine.relighter import Relighter
    from ..light.environment import Environment

PICTURE_SIZE = 960, 720

LEAST_LIGHT = 1e-6
"""Mean luminance of an environment below which its sky is black."""


class Results:
    """Writes the results of a scene, light after light.

    kinds: words of `kinds.FILES`. baked: some of `kinds.BAKED`. splats: (Splats, paths of their files), None where no
    result needs them. texture_size: side of textures in texels, chosen without. sky: of `splats.SKIES`, for the far
    background of splats. live: whether "glb" brings the mesh with live light too. harmonics: of `kinds.HARMONICS`.
    """

    def __init__(
        self,
        relighter: "Relighter",
        appearance: "Appearance",
        kinds: Sequence[str],
        baked: Sequence[str] = (),
        splats: tuple[Splats, list[Path]] | None = None,
        texture_size: int | None = None,
        seed: int = 0,
        sky: str = "new",
        live: bool = False,
        harmonics: str = "zero",
    ) -> None:
        self._relighter, self._appearance, self._kinds, self._baked = relighter, appearance, kinds, baked
        self._splats: Splats | None
        self._splats, self._paths = splats or (None, [])
        self._texture_size, self._seed, self._sky = texture_size, seed, sky
        self._live, self._harmonics = live, harmonics
        self._scene, self._stages = relighter.scene, relighter.stages
        self._preview: Any = None
        self._binding: Any = None
        self._texture: Any = None
        self._nine: Any = None
        self._bare: Any = None

    def write(
        self, folder: Path, light: "Environment", radiance: NDArray[np.float32], exposure: float
    ) -> tuple[list[str], dict[str, Any]]:
        """Fill a folder that exists: (names of the files, what else the report should tell).

        radiance: (V, 3) linear. exposure: display value per unit of it.
        """
        names = [FILES[kind] for kind in FILES if kind in self._kinds]
        told: dict = {}
        with self._stages.stage("write"):
            if "glb" in self._kinds:
                extras = {"environment": light.name, "angle_deg": light.rotation_deg}
                clipped = mesh_files.write_glb(folder / FILES["glb"], self._scene, radiance, exposure, extras)
                told["clipped_vertices"] = clipped
            if "ply" in self._kinds:
                mesh_files.write_ply(folder / FILES["ply"], self._scene, radiance, exposure)
            if "npy" in self._kinds:
                mesh_files.write_npy(folder / FILES["npy"], self._scene, radiance)
        if "glb" in self._kinds and self._live:
            names += self._write_live(folder, light, exposure)
        if "albedo-splat" in self._kinds:
            names += self._write_albedo_splats(folder)
        relit = self.relit_splats(light, radiance, exposure) if {"splat", "splat-glb", "usd"} & {*self._kinds} else None
        if "splat" in self._kinds:
            names += self._write_splats(folder, relit)
        if "splat-glb" in self._kinds:
            from .splat_glb import write_splat_glb

            with self._stages.stage("write"):
                extras = {"environment": light.name, "angle_deg": light.rotation_deg, "exposure": exposure}
                write_splat_glb(folder / FILES["splat-glb"], relit, self._scene.scene_from_splat, extras)
        if "usd" in self._kinds:
            names += self._write_usd(folder, relit, light, exposure)
        if self._baked:
            names += self._write_textures(folder, light, radiance, exposure, told)
        if "png" in self._kinds:
            self._write_picture(folder, light, radiance, exposure)
        return names, told

    def _write_picture(self, folder, light, radiance, exposure):
        from .preview import Preview

        with self._stages.stage("preview"):
            self._preview = self._preview or Preview(self._scene, None, *PICTURE_SIZE)
            mesh_files.write_png(folder / FILES["png"], self._preview.render(radiance, light, exposure))

    def relit_splats(self, light: "Environment", radiance: NDArray[np.float32], exposure: float) -> Splats:
        """The splats in the new light, row by row those of the source, in its frame."""
        from ..splats import under_sky

        rows, frame = self._scene.background_splats, self._scene.scene_from_splat
        capture = self._appearance.capture
        if (
            capture is not None and self._appearance.kept
        ):  # the sky as bright as in the capture, whose exposure they have
            exposure = capture["brightness"] / max(light.mean_luminance, LEAST_LIGHT)
            return under_sky(self._splats, rows, light, frame, exposure, self._sky)
        binding = self._bound()
        with self._stages.stage("relight splats"):
            received = self._appearance.received(radiance)
            relit = binding.relit(self._appearance.irradiance, received, exposure)
            return under_sky(relit, rows, light, frame, exposure, self._sky)

    def _bound(self):
        """The Binding of the splats."""
        from ..splats import Binding

        if self._binding is None:
            with self._stages.stage("bind splats"):
                self._binding = Binding(self._splats, self._scene, seed=self._seed)
        return self._binding

    @property
    def _source(self):
        """The one file that the splats were read from, or None."""
        return self._paths[0] if len(self._paths) == 1 else None

    def _write_live(self, folder, light, exposure):
        """The mesh with live light: names of files beyond FILES."""
        from ..engine.nine import nine_coefficients
        from .live_glb import FILE, write_live_glb

        albedo = self._appearance.albedo
        if self._nine is None:
            with self._stages.stage("live"):
                self._nine = nine_coefficients(self._relighter, albedo)
        with self._stages.stage("write"):
            write_live_glb(folder / FILE, self._scene, albedo, *self._nine, light, exposure)
        return [FILE]

    def _albedo_splats(self):
        """The splats with the light of the capture taken out, and their normals (N, 3)."""
        from ..splats import albedo_splats, normals_of

        if self._bare is None:
            binding, rows = self._bound(), self._scene.background_splats
            with self._stages.stage("albedo splats"):
                sky = "keep" if self._sky == "keep" else "drop"
                look = None if self._appearance.kept else binding
                bare = albedo_splats(self._splats, look, self._appearance, rows, self._harmonics, sky)
                self._bare = bare, normals_of(binding)
        return self._bare

    def _write_albedo_splats(self, folder):
        """The splats as albedo, and the mesh in their frame and in that of PlayCanvas: names of files beyond FILES."""
        from ..splats import write_relit_ply
        from .proxy import PLAYCANVAS_FROM_SPLAT, write_proxy_glb

        splats, normals = self._albedo_splats()
        back = np.linalg.inv(self._scene.scene_from_splat)
        name = FILES["albedo-splat"]
        names = ["proxy.glb", f"{name.partition('.')[0]}.collision.glb"]
        albedo = self._appearance.albedo
        with self._stages.stage("write"):
            write_relit_ply(folder / name, splats, self._source, normals)
            white = np.ones_like(self._appearance.captured)
            write_proxy_glb(folder / names[0], self._scene, back, white if albedo is None else albedo)
            write_proxy_glb(folder / names[1], self._scene, PLAYCANVAS_FROM_SPLAT @ back)
        return names

    def _write_usd(self, folder, relit, light, exposure):
        """Splats, proxy and dome as USD: names of files beyond FILES."""
        from .usd import LIGHT, write_usd

        looks = {"relit": relit}
        if "albedo-splat" in self._kinds:
            looks["albedo"] = self._albedo_splats()[0]
        albedo = self._appearance.albedo
        shown = np.ones_like(self._appearance.captured) if albedo is None else albedo
        with self._stages.stage("write"):
            write_usd(folder, looks, self._scene, shown, light, exposure)
        return [LIGHT]

    def _write_splats(self, folder, relit):
        """The splats in the new light, also in the format of their source: names of files beyond FILES."""
        from ..splats import write_relit_ply

        with self._stages.stage("write"):
            source = self._source
            write_relit_ply(folder / FILES["splat"], relit, source)
            kind = kind_of(source) if source else "ply"
            if kind == "ply" or kind not in WRITERS:
                return []
            name = f"relit_splat.{kind}"
            write_splats(folder / name, relit, kind)
        return [name]

    def _write_textures(self, folder, light, radiance, exposure, told):
        """Write textured meshes, relit and as albedo, and on request the transfer. Returns the names of the files."""
        from ..texture import bake
        from .textured_files import write_textured_glb, write_transfer

        appearance = self._appearance
        if self._texture is None:
            known = {"irradiance": appearance.irradiance, "prior": appearance.prior}
            if appearance.prior is None:  # nothing was estimated: the texels take the albedo of the vertices
                white = np.ones_like(appearance.captured)
                known = {"albedo": white if appearance.albedo is None else appearance.albedo}
                known = {} if appearance.albedo is appearance.captured else known
            known |= {"size": self._texture_size, "stages": self._stages, "seed": self._seed}
            self._texture = bake(self._scene, self._splats, **known)
        names = ["relit_texture.glb", "albedo_texture.glb"]
        told["texture"] = {"size": self._texture.atlas.size, "unseen_texels": self._texture.unseen}
        with self._stages.stage("write"):
            extras = {"environment": light.name, "angle_deg": light.rotation_deg, "exposure": exposure}
            picture = self._texture.relit(appearance.received(radiance, exposure), exposure)
            write_textured_glb(folder / names[0], self._scene, self._texture, picture, True, extras)
            albedo = self._texture.image(self._texture.albedo)
            write_textured_glb(folder / names[1], self._scene, self._texture, albedo, False)
            if "transfer" in self._baked:
                names += write_transfer(folder, self._texture, self._relighter.transfer)
        return names
