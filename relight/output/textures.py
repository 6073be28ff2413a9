"""The textures of a scene under one light after another: relit.glb by that of mesh.glb, and the files of --bake."""

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Radiance
from splat2mesh.scene.drawn import Drawn
from splat2mesh.texture.glb import add_cards, jpeg_bytes, textured_glb
from splat2mesh.texture.kept import added_part, textured_part

from ..texture import Baked, bake, known_colors, own_texture
from ..transfer.store import array_key
from .images import png_bytes
from .lamps_glb import PlacedLamps, add_lamps
from .relit_splats import RelitSource
from .subject import LitFolder, WrittenScene
from .textured_files import Skin, write_textured_glb, write_transfer

if TYPE_CHECKING:
    from splat2mesh.scene.mesh import Mesh

    from ..engine.relighter import Shaded

FILES = "relit_texture.glb", "albedo_texture.glb"
"""Files of `--bake texture`."""


class SceneTextures:
    """Textures without the light of the capture, each made when it is first needed, and their files.

    relit: RelitSource of the same scene. Without the size of a texture for --bake that of mesh.glb serves, and where
    there is none one as fine as the splats.
    """

    def __init__(self, written: WrittenScene, relit: RelitSource) -> None:
        self._written, self._relighter, self._appearance = written, written.relighter, written.appearance
        self._relit, self._size, self._seed = relit, written.asked.texture_size, written.asked.seed
        self._scene, self._stages = written.scene, written.stages
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

    def write_relit(self, path: Path, shaded: "Shaded", extras: dict[str, Any], placed: PlacedLamps) -> None:
        """Write relit.glb in the texture of mesh.glb."""
        own, exposure = self._own, shaded.exposure
        assert own is not None
        picture = jpeg_bytes(own.relit(self._received(shaded), exposure))
        file = textured_glb(self._part.scene, own.atlas, [picture], len(self._part.scene.chunks), "relit")
        add_cards(file, self._without_texture(self._shown(shaded)))
        add_lamps(file, placed)
        file.save(path, {"exposure": float(exposure), **extras})

    def write(self, into: LitFolder) -> list[str]:
        """Write the textured meshes of --bake, relit and as albedo, and on request the transfer; returns the names of
        the files."""
        folder, shaded, baked, part = into.path, self._written.shown(into.shaded), self._baked, self._part
        light = shaded.light
        with self._stages.stage("write"):
            extras = {"environment": light.name, "angle_deg": light.rotation_deg, "exposure": shaded.exposure}
            others, skin = self._without_texture(self._shown(shaded)), Skin(baked, png_bytes(self.picture(shaded)))
            write_textured_glb(folder / FILES[0], part.scene, skin, extras=extras, others=others)
            rough = None if self._written.gloss is None else self._written.gloss.roughness(self._appearance)
            rough = None if rough is None else part.values(rough)
            others, skin = self._without_texture(self._written.albedo), Skin(baked, png_bytes(baked.relit()), rough)
            write_textured_glb(folder / FILES[1], part.scene, skin, False, others=others)
            names = list(FILES)
            if "transfer" in self._written.asked.baked:
                names += write_transfer(folder, baked, part.values(self._relighter.transfer))
        into.facts["texture"] = {"size": baked.atlas.size, "unseen_texels": baked.unseen}
        return names

    def painter(self, shaded: "Shaded") -> "tuple[Any, NDArray[np.uint8]]":
        """The Atlas of --bake and its picture under a light, (size, size, 3) uint8 sRGB."""
        return self._baked.atlas, self.picture(shaded)

    def picture(self, shaded: "Shaded") -> NDArray[np.uint8]:
        """The texture of --bake under a light, (size, size, 3) uint8 sRGB."""
        return self._baked.relit(self._received(shaded), shaded.exposure)

    def _received(self, shaded: "Shaded") -> Radiance:
        return self._part.values(self._relit.received(shaded.shading, shaded.exposure))

    def _shown(self, shaded: "Shaded") -> Radiance:
        return shaded.shading.radiance * np.float32(shaded.exposure)

    def _without_texture(self, shown: Radiance) -> "list[tuple[Mesh, Radiance]]":
        """Cards, and what was added after the texture was made, with what their vertices show, of (V, 3) linear."""
        return self._drawn.cards_in(shown) + added_part(self._scene, shown)

    @cached_property
    def _own(self) -> Baked | None:
        """The texture of mesh.glb, or None."""
        return (self._written.texture or own_texture(self._scene, self._appearance))()

    @cached_property
    def _baked(self) -> Baked:
        """The texture of --bake: that of mesh.glb, or one from the cache if it was baked before."""
        if self._size is None and self._own is not None:
            return self._own
        cache, scene = self._relighter.cache, self._part.scene
        known = known_colors(self._part, self._appearance)
        text = repr((self._size, self._seed, scene.source.get("sha256"), known.albedo is None, known.prior is None))
        values = [known.irradiance if known.albedo is None else known.albedo]
        key = array_key(np.frombuffer(text.encode(), np.uint8), scene.colors_srgb, *values)
        kept = cache.get("texels", key)
        if kept is not None:
            return Baked.of_arrays(kept)
        made = bake(scene, self._written.source, known, size=self._size, stages=self._stages, seed=self._seed)
        cache.put("texels", key, **made.arrays())
        return made
