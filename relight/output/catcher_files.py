"""catcher.ply and catcher.exr: the effect of inserted objects on the place, as factors on its light."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats
from splat2mesh.base.outputs import staged_file
from splat2mesh.scene.color import BLACK, linear_from_srgb
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.formats.inria import header_of, row_type
from splat2mesh.splats.formats.ply import Ply
from splat2mesh.splats.splats import SH_C0, Splats

from ..splats import write_relit_ply
from .images import write_exr
from .inserted_picture import camera_of
from .kinds import FILES, PICTURE_SIZE
from .picture import RelitPicture

if TYPE_CHECKING:
    from ..insert.inserts import InsertedLight

PICTURE = "catcher.exr"

RATIOS = ("ratio_r", "ratio_g", "ratio_b")
"""Properties of catcher.ply beyond those of any splat."""


def write_catcher(
    folder: Path,
    without: Splats,
    relit: Splats,
    scene: Scene,
    inserted: "InsertedLight",
    source: Path | None = None,
) -> list[str]:
    """Write the ratio of every splat, and a picture of it from the camera of inserted.png. Returns the names.

    without, relit: Splats of the place, row by row, without and with what the objects change. source: the
    file that they were read from, where it is one.
    """
    _write_splats(folder / FILES["catcher"], relit, ratios(without, relit), source)
    picture = RelitPicture(scene, camera_of(inserted, scene), PICTURE_SIZE, samples=1)
    before, after = (_linear(picture.seen(each).color) for each in (without, relit))
    write_exr(folder / PICTURE, {"RGB": _over(before, after)})  # exactly 1 where they agree
    return [FILES["catcher"], PICTURE]


def ratios(without: Splats, relit: Splats) -> NDArray[np.float32]:
    """(N, 3) float32: linear light of the constant colours of relit splats over that of the same without objects.

    Exactly 1 where no bit changes, and where the colour was black.
    """
    before, after = (_linear(each.colors_diffuse) for each in (without, relit))
    found = _over(before, after)
    found[(without.sh[:, 0] == relit.sh[:, 0]).all(axis=1)] = 1.0
    return found


def _linear(color: Floats) -> NDArray[np.float64]:
    return np.asarray(linear_from_srgb(np.maximum(np.nan_to_num(color), 0.0).astype(np.float64)), np.float64)


def _over(before: NDArray[np.float64], after: NDArray[np.float64]) -> NDArray[np.float32]:
    return np.divide(after, before, out=np.ones_like(before), where=before > BLACK).astype(np.float32)


def _write_splats(path: Path, splats: Splats, ratio: NDArray[np.float32], source: Path | None) -> None:
    """Splats whose colours are their ratios, which no view changes, and the ratios as separate properties."""
    sh = ((ratio - np.float32(0.5)) / np.float32(SH_C0))[:, None]
    write_relit_ply(path, replace(splats, sh=sh), source)
    rows: NDArray[Any] = np.array(Ply.open(path).rows("vertex"))
    names = [*(rows.dtype.names or ()), *RATIOS]
    double = rows.dtype["x"].itemsize == 8
    packed = np.empty(len(rows), row_type(names, double))
    for name in names:
        packed[name] = ratio[:, RATIOS.index(name)] if name in RATIOS else rows[name]
    with staged_file(path) as staging, open(staging, "wb") as file:
        file.write(header_of(len(packed), names, splats.facts, double) + packed.tobytes())
