"""The textures of a scene under one light after another: relit.glb by that of mesh.glb, and the files of --bake."""

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Radiance
from splat2mesh.base.errors import InputError
from splat2mesh.base.outputs import staged_file
from splat2mesh.base.strictjson import text_of
from splat2mesh.scene.drawn import Drawn
from splat2mesh.scene.glb import Glb
from splat2mesh.scene.scene import Scene
from splat2mesh.texture.glb import add_cards, jpeg_bytes, textured_glb
from splat2mesh.texture.kept import added_part, textured_part

from ..engine.relighter import Shaded
from ..output.images import png_bytes, write_exr, write_png
from ..output.lamps_glb import PlacedLamps, add_lamps
from ..texture import Atlas, Baked, bake, known_colors, own_texture
from ..transfer import FEW_BANDS
from ..transfer.store import array_key
from .job import Job
from .part_lights import PartLights
from .relit_source import RelitSource
from .scene_files import LitFolder

if TYPE_CHECKING:
    from splat2mesh.scene.mesh import Mesh

FILES = "relit_texture.glb", "albedo_texture.glb"
"""Files of `--bake texture`."""


class SceneTextures:
    """Textures without the light of the capture, each made when it is first needed, and their files.

    parts, source: of the same job. Without the size of a texture for --bake that of mesh.glb serves, and where there is
    none one as fine as the splats.
    """

    def __init__(self, job: Job, parts: PartLights, source: RelitSource) -> None:
        self._job, self._parts, self._source, self._known = job, parts, source, job.known
        self._scene, self._appearance = job.known.scene, job.known.appearance
        self._drawn, self._part = Drawn(self._scene), textured_part(self._scene)

    @property
    def shows_vertices(self) -> bool:
        """Whether relit.glb has the colours of vertices: no texture, or an albedo that is known of vertices alone."""
        look = self._appearance
        return (look.prior is None and look.albedo is not look.captured) or self._own is None

    @property
    def is_whole(self) -> bool:
        """Whether all that is drawn has a texture."""
        return not self._scene.left

    def write_relit(self, path: Path, shaded: Shaded, extras: dict[str, Any], placed: PlacedLamps) -> None:
        """Write relit.glb in the texture of mesh.glb."""
        own, exposure = self._own, shaded.exposure
        assert own is not None
        picture = jpeg_bytes(own.relit(self._received(shaded), exposure))
        file = textured(self._part.scene, own.atlas, [picture], self._without_texture(self._shown(shaded)))
        add_lamps(file, placed)
        file.save(path, {"exposure": float(exposure), **extras})

    def write(self, into: LitFolder) -> list[str]:
        """Write the textured meshes of --bake, relit and as albedo, and on request the transfer; returns the names of
        the files."""
        folder, shaded, baked, part = into.path, self._parts.shown(into.shaded), self.baked, self._part
        light = shaded.light
        with self._job.stages.stage("write"):
            extras = {"environment": light.name, "angle_deg": light.rotation_deg, "exposure": shaded.exposure}
            others, picture = self._without_texture(self._shown(shaded)), png_bytes(self.picture(shaded))
            textured(part.scene, baked.atlas, [picture], others).save(folder / FILES[0], extras)
            others, pictures = self._without_texture(self._known.albedo), [png_bytes(baked.relit())]
            if self._known.roughness is not None:
                pictures.append(gloss_picture(baked.atlas, part.values(self._known.roughness)))
            textured(part.scene, baked.atlas, pictures, others, unlit=False).save(folder / FILES[1])
            names = list(FILES)
            if "transfer" in self._job.request.baked:
                names += write_transfer(folder, baked, part.values(self._known.relighter.transfer))
        into.facts["texture"] = {"size": baked.atlas.size, "unseen_texels": baked.unseen}
        return names

    def picture(self, shaded: Shaded) -> NDArray[np.uint8]:
        """The texture of --bake under a light, (size, size, 3) uint8 sRGB."""
        return self.baked.relit(self._received(shaded), shaded.exposure)

    def _received(self, shaded: Shaded) -> Radiance:
        return self._part.values(self._source.received(shaded.shading, shaded.exposure))

    def _shown(self, shaded: Shaded) -> Radiance:
        return shaded.shading.radiance * np.float32(shaded.exposure)

    def _without_texture(self, shown: Radiance) -> "list[tuple[Mesh, Radiance]]":
        """Cards, and what was added after the texture was made, with what their vertices show, of (V, 3) linear."""
        return self._drawn.cards_in(shown) + added_part(self._scene, shown)

    @cached_property
    def _own(self) -> Baked | None:
        """The texture of mesh.glb, or None."""
        return (self._known.texture or own_texture(self._scene, self._appearance))()

    @cached_property
    def baked(self) -> Baked:
        """The texture of --bake: that of mesh.glb, or one from the cache if it was baked before."""
        size, seed = self._job.request.texture_size, self._job.request.lighting.seed
        if size is None and self._own is not None:
            return self._own
        cache, scene = self._known.relighter.cache, self._part.scene
        known = known_colors(self._part, self._appearance)
        text = repr((size, seed, scene.source.get("sha256"), known.albedo is None, known.prior is None))
        values = [known.irradiance if known.albedo is None else known.albedo]
        key = array_key(np.frombuffer(text.encode(), np.uint8), scene.colors_srgb, *values)
        kept = cache.get("texels", key)
        if kept is not None:
            return Baked.of_arrays(kept)
        made = bake(scene, self._job.inputs.shown_splats, known, size=size, stages=self._job.stages, seed=seed)
        cache.put("texels", key, **made.arrays())
        return made


def textured(
    scene: Scene,
    atlas: Atlas,
    pictures: list[bytes],
    others: "Sequence[tuple[Mesh, Radiance]]" = (),
    unlit: bool = True,
) -> Glb:
    """The scene as binary glTF 2.0: a mesh per chunk with TEXCOORD_0, one material, the pictures inside.

    Vertices stand in the order of the atlas; on seams of the texture there are several of one scene vertex. The same
    input gives the same bytes. pictures: JPEG or PNG, that of `gloss_picture` second. others: without a texture, with
    (V, 3) linear colours. unlit: shown so; else lit by the viewer, as a matt surface.
    """
    file = textured_glb(scene, atlas, pictures, len(scene.chunks), "relit" if unlit else "albedo", unlit)
    add_cards(file, others, unlit)
    return file


def gloss_picture(atlas: Atlas, roughness: NDArray[np.float32]) -> bytes:
    """PNG of the roughness of vertices (V,) as glTF has it: in green, no metal in blue."""
    values = np.stack([np.ones_like(roughness), roughness, np.zeros_like(roughness)], axis=1)
    return png_bytes(atlas.image(np.rint(255.0 * np.clip(atlas.interpolate(values), 0.0, 1.0)).astype(np.uint8)))


def write_transfer(
    folder: Path,
    baked: Baked,
    transfer: NDArray,  # (V, K) of the vertices, K >= 9
) -> list[str]:
    """Write transfer_0.exr, transfer_1.exr and transfer_2.exr: linear half floats, unscaled.

    Image i holds coefficients 3 i, 3 i + 1 and 3 i + 2 in R, G and B, those of the vertices interpolated. With
    albedo.png and transfer.json, which says the same, a shader can light the mesh: see docs/texture.md.
    Returns the names of the files. Raises InputError for another shape.
    """
    transfer, atlas = np.asarray(transfer), baked.atlas
    if transfer.ndim != 2 or len(transfer) != atlas.vertices or transfer.shape[1] < FEW_BANDS**2:
        raise InputError(f"transfer images need ({atlas.vertices}, 9) coefficients or more, found {transfer.shape}")
    values = atlas.interpolate(transfer[:, : FEW_BANDS**2])
    names = []
    for index in range(FEW_BANDS):
        names.append(f"transfer_{index}.exr")
        image = atlas.image(values[:, 3 * index : 3 * index + 3].astype(np.float16))
        write_exr(folder / names[-1], {"RGB": image})
    names.append("albedo.png")
    write_png(folder / names[-1], baked.relit())
    facts = {
        "images": names[:FEW_BANDS],
        "albedo": "albedo.png",
        "bands": FEW_BANDS,
        "order": "image i holds coefficients 3 i, 3 i + 1, 3 i + 2 in R, G, B; index l (l + 1) + m",
        "basis": "real, orthonormal, all-positive",
        "scale": 1.0,
        "offset": 0.0,
        "includes": "cosine lobe over pi and shadows: constant light of radiance 1 gives 1 where nothing hides it",
        "texels": "interpolated from the vertices",
    }
    names.append("transfer.json")
    with staged_file(folder / names[-1]) as staging:
        staging.write_text(text_of(facts, indent=1) + "\n", encoding="utf-8")
    return names
