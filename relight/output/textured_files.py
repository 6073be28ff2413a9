"""Textured scenes as files: GLB with the picture inside, and transfer as images for shaders."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import InputError
from splat2mesh.base.outputs import staged_file
from splat2mesh.base.strictjson import text_of
from splat2mesh.texture.glb import add_cards, textured_glb

from ..transfer import FEW_BANDS
from .images import png_bytes, write_exr, write_png

if TYPE_CHECKING:
    from splat2mesh.scene.mesh import Mesh
    from splat2mesh.scene.scene import Scene
    from splat2mesh.texture.atlas import Atlas

    from ..texture.baking import Baked


class Skin(NamedTuple):
    """A texture of a scene and what it shows. picture: JPEG or PNG of (size, size, 3) sRGB. roughness: (V,) of the
    vertices, as glTF has it; matt without."""

    baked: "Baked"
    picture: bytes
    roughness: NDArray[np.float32] | None = None


def write_textured_glb(
    path: str | Path,
    scene: "Scene",
    skin: Skin,
    unlit: bool = True,  # shown unlit; False: lit by the viewer, as a matt surface
    extras: dict | None = None,  # dict of JSON values, kept in the glTF scene's `extras`
    others: "Sequence[tuple[Mesh, NDArray[np.float32]]]" = (),  # without a texture, with (V, 3) linear colours
) -> None:
    """Write the scene as binary glTF 2.0: a mesh per chunk with TEXCOORD_0, one material, the picture inside.

    Vertices stand in the order of the atlas; on seams of the texture there are several of one scene vertex. The same
    input gives the same bytes.
    """
    atlas, roughness = skin.baked.atlas, skin.roughness
    pictures = [skin.picture] if roughness is None else [skin.picture, png_bytes(_gloss_image(atlas, roughness))]
    file = textured_glb(scene, atlas, pictures, len(scene.chunks), "relit" if unlit else "albedo", unlit)
    add_cards(file, others, unlit)
    file.save(path, extras)


def write_transfer(
    folder: Path,
    baked: "Baked",
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
    folder = Path(folder)
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


def _gloss_image(atlas: "Atlas", roughness: NDArray[np.float32]) -> NDArray[np.uint8]:
    """(size, size, 3) uint8 as glTF has it: roughness in green, no metal in blue."""
    values = np.stack([np.ones_like(roughness), roughness, np.zeros_like(roughness)], axis=1)
    return atlas.image(np.rint(255.0 * np.clip(atlas.interpolate(values), 0.0, 1.0)).astype(np.uint8))
