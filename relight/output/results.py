"""Write the files of one light after another: meshes, splats, textures, a picture. Shared parts are made once."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.beside import Beside
from splat2mesh.splats.splats import Splats

from . import mesh_files
from .around_files import AroundFiles
from .clean_files import CleanFiles
from .engine_files import EngineFiles
from .kinds import FILES, OUTPUTS, SHEET
from .live_files import LiveFiles
from .offered_lights import offered_pictures
from .pass_files import PassFiles
from .relit_splats import RelitSource
from .subject import WrittenScene
from .textures import SceneTextures

if TYPE_CHECKING:
    from ..engine.relighter import Shaded
    from ..insert.inserts import InsertedLight
    from ..live.objects import LiveObjects
    from .picture import RelitPicture

PICTURE_SIZE = 960, 720

BEFORE = "captured", "albedo"
"""Labels of the pictures before the lights on the sheet."""

INSERTED = "inserted.glb", "inserted.png"
"""Files of inserted objects, and of a picture of them in the scene."""


@dataclass(frozen=True, eq=False)
class OwnWriters:
    """Writers of kinds with separate files; None for kinds not requested.

    live: live files. engines: files for engines. around: files on the surrounding light. clean: the splats without
    floaters. passes: those of the mesh.
    """

    live: LiveFiles | None = None
    engines: EngineFiles | None = None
    around: AroundFiles | None = None
    clean: CleanFiles | None = None
    passes: PassFiles | None = None


class Results:
    """Writes the results of a scene, light after light.

    kinds: words of `kinds.FILES`. baked: some of `kinds.BAKED`. texture_size: side of textures in texels, chosen
    without. others: the writers of kinds that have files of their own.
    """

    def __init__(
        self,
        written: WrittenScene,
        kinds: Sequence[str],
        baked: Sequence[str] = (),
        texture_size: int | None = None,
        others: OwnWriters = OwnWriters(),
    ) -> None:
        self._bound = written.binding
        self._live, self._engines, self._around = others.live, others.engines, others.around
        self._clean, self._passes = others.clean, others.passes
        self._relighter, self._appearance = written.relighter, written.appearance
        self._kinds, self._baked = kinds, baked
        self._splats = None if written.splats is None else written.splats[0]
        self._relit = RelitSource(written)
        self._lamps = written.lamps
        self._scene, self._stages = self._relighter.scene, self._relighter.stages
        self._textures = SceneTextures(written, self._relit, texture_size)
        self._picture: Any = None
        self._last_picture: NDArray[np.uint8] | None = None
        self._on_sheet: list[tuple[str, NDArray[np.uint8]]] = []
        self._before_lights = 0

    def write(self, folder: Path, shaded: "Shaded") -> tuple[list[str], dict[str, Any]]:
        """Fill an existing folder: (names of the files, further entries of the report)."""
        pictured = "png" in self._kinds or "splat" in self._kinds  # what is written as a splat is shown too
        kinds = {*self._kinds, "png"} if pictured else self._kinds
        names = [each.file for kind, each in OUTPUTS.items() if kind in kinds and not each.writer]
        facts: dict = {}
        relit = glb = files = None
        with ExitStack() as begun:
            if "glb" in self._kinds:
                facts["clipped_vertices"] = 0
                glb = begun.enter_context(self._begin_glb(folder / FILES["glb"], shaded))
            with self._stages.stage("write"):
                if "ply" in self._kinds:
                    mesh_files.write_ply(folder / FILES["ply"], self._scene, shaded.shading.radiance, shaded.exposure)
                if "npy" in self._kinds:
                    mesh_files.write_npy(folder / FILES["npy"], self._scene, shaded.shading.radiance)
            if self._splats is not None and (
                pictured or self._around is not None or (self._engines is not None and self._engines.wants_relit)
            ):
                relit = self._relit.relit(shaded)
            place = len(names)
            if "splat" in self._kinds and relit is not None:
                files = begun.enter_context(Beside(partial(self._relit.write, folder, relit)))
                if shaded.inserted is not None:
                    files.result()  # objects are added to it
            self._write_others(folder, shaded, relit, names, facts)
            if glb is not None:
                facts["clipped_vertices"] = glb.result()
            names[place:place] = [] if files is None else files.result()
        return names, facts

    def _write_others(
        self, folder: Path, shaded: "Shaded", relit: Splats | None, names: list[str], facts: dict[str, Any]
    ) -> None:
        """Write all but the mesh and the splats, and add to the names and the entries of the report."""
        light, exposure = shaded.light, shaded.exposure
        if shaded.inserted is not None:
            names += self._write_inserted(folder, relit, shaded)
        if self._baked:
            written, facts["texture"] = self._textures.write_baked(folder, shaded, self._baked)
            names += written
        if self._engines is not None:
            names += self._engines.write(folder, light, exposure, relit, self._bound, shaded.backdrop)
        if self._around is not None and relit is not None:
            with self._stages.stage("around"):
                names += self._around.write(
                    folder, relit, shaded, lambda: self._relit.without_objects(shaded), PICTURE_SIZE
                )
        if self._passes is not None:
            with self._stages.stage("passes"):
                names += self._passes.write(folder, shaded, PICTURE_SIZE)
        if self._clean is not None:
            names += self._clean.write(folder)
            facts["clean_splat"] = self._clean.report
        if self._live is not None:
            objects = self._live_objects(relit, shaded)
            written, facts["live"] = self._live.write(folder, light, exposure, self._kinds, objects)
            names += written
        if "png" in self._kinds or "splat" in self._kinds:
            with self._stages.stage("preview"):
                self._last_picture = self._painted(relit, shaded)
                mesh_files.write_png(folder / FILES["png"], self._last_picture)
            shown = "splat" if relit is not None else "texture" if self._shows_texture else "mesh"
            facts["preview"] = {"shows": shown, "camera": self._picture.camera}

    def _begin_glb(self, path: Path, shaded: "Shaded") -> Beside[int]:
        """Begin to write relit.glb beside other work, in its texture where the scene has one: the number of vertices
        that are clipped."""
        radiance, exposure, textured = shaded.shading.radiance, shaded.exposure, not self._textures.shows_vertices
        placed = self._lamps(shaded.light, exposure)
        extras: dict[str, Any] = {"environment": shaded.light.name, "angle_deg": shaded.light.rotation_deg}

        def write() -> int:
            with self._stages.stage("write"):
                if not textured:
                    return mesh_files.write_glb(path, self._scene, radiance, exposure, extras, placed)
                exposed = mesh_files.check_radiance(self._scene, radiance) * exposure
                clipped = int((exposed > 1.0).any(axis=1).sum())
                self._textures.write_relit(path, shaded, {"clipped_vertices": clipped, **extras}, placed)
                return clipped

        return Beside(write)

    @property
    def _shows_texture(self) -> bool:
        """Whether pictures of the mesh show the texture of --bake."""
        return bool(self._baked) and self._textures.is_whole

    def _write_inserted(self, folder: Path, relit: Splats | None, shaded: "Shaded") -> list[str]:
        """Write the lit inserted objects, and a picture of them in the scene: names of the files."""
        from .inserted_glb import write_inserted_glb
        from .inserted_picture import camera_of
        from .joined_splats import append_splats

        names: list[str] = []
        with self._stages.stage("write"):
            if any(each.splat is None for each in shaded.inserted.standing.objects):
                write_inserted_glb(folder / INSERTED[0], shaded.inserted, shaded.exposure)
                names.append(INSERTED[0])
            if "splat" in self._kinds and relit is not None:
                splats = self._relit.put_in(shaded.inserted, shaded.exposure)
                if splats is not None:
                    append_splats(folder / FILES["splat"], splats, relit.facts)
        if relit is None:
            return names
        with self._stages.stage("preview"):
            picture = self._new_picture(camera_of(shaded.inserted, self._scene))
            mesh_files.write_png(folder / INSERTED[1], self._of_splats(picture, relit, shaded))
        return [*names, INSERTED[1]]

    def _live_objects(self, relit: Splats | None, shaded: "Shaded") -> "LiveObjects | None":
        """The inserted objects in the form of the page and the bundle, or None."""
        if shaded.inserted is None:
            return None
        from ..live.movable import movables_of
        from ..live.objects import objects_of
        from .inserted_glb import write_inserted_glb

        content = b""
        if any(each.splat is None for each in shaded.inserted.standing.objects):
            with TemporaryDirectory() as staging:
                write_inserted_glb(Path(staging) / INSERTED[0], shaded.inserted, shaded.exposure)
                content = (Path(staging) / INSERTED[0]).read_bytes()
        relit = self._relit.relit(shaded) if relit is None else relit
        movable = movables_of(shaded.inserted, shaded.exposure)
        return objects_of(self._relit.without_objects(shaded), relit, content, shaded.light.rotation_deg, movable)

    def object_painter(
        self, shaded: "Shaded", poses: "list[InsertedLight]"
    ) -> "Callable[[InsertedLight], NDArray[np.uint8]]":
        """The function that draws moving objects under a light: splats if there are any, else the mesh.

        shaded: with the objects in any pose. poses: some of those to come."""
        from ..insert.shadowed import ShadowedSplats
        from .inserted_picture import camera_of
        from .object_picture import mesh_with_objects

        points = np.concatenate([pose.standing.vertices for pose in poses])
        camera = camera_of(poses[len(poses) // 2], self._scene, points)
        light = shaded.sky
        radiance = shaded.shading.radiance / shaded.inserted.ratio
        if self._splats is None:
            exposure = shaded.exposure
            return lambda pose: mesh_with_objects(self._scene, radiance, pose, camera, PICTURE_SIZE, light, exposure)
        floor = self._relit.floor_under(shaded.inserted, shaded.exposure)
        bound = ShadowedSplats(poses, self._relit.without_objects(shaded), floor)
        picture = self._new_picture(camera)

        def drawn(pose: "InsertedLight") -> NDArray[np.uint8]:
            return self._of_splats(picture, bound.under(pose), shaded._replace(inserted=pose))

        return drawn

    def _of_splats(self, picture: Any, relit: Splats, shaded: "Shaded") -> NDArray[np.uint8]:
        """A picture of relit splats with the inserted objects."""
        light = shaded.sky
        if shaded.inserted is not None:
            from .inserted_picture import with_objects

            floor = self._relit.floor_under(shaded.inserted, shaded.exposure)
            relit = with_objects(relit, shaded.inserted, shaded.exposure, picture.view, self._scene, floor=floor)
        return picture.of_splats(relit, light, shaded.exposure * shaded.backdrop)

    def _new_picture(self, camera: dict[str, Any] | None) -> "RelitPicture":
        """A RelitPicture of the scene; without a camera, by its own."""
        from .picture import RelitPicture

        return RelitPicture(self._scene, camera, *PICTURE_SIZE, indoors=self._appearance.room is not None)

    def _painted(self, relit: Splats | None, shaded: "Shaded") -> NDArray[np.uint8]:
        """The picture, (H, W, 3) uint8: of the relit splats, else of the texture, else of the mesh, as there are."""
        light = shaded.sky
        exposure, behind = shaded.exposure, shaded.exposure * shaded.backdrop
        self._picture = self._picture or self._new_picture(None)
        if relit is not None:
            return self._of_splats(self._picture, relit, shaded)
        if self._shows_texture:
            return self._picture.of_texture(*self._textures.painter(shaded), light, behind)
        return self._picture.of_vertices(shaded.shading.radiance, light, exposure)

    def add_to_sheet(self, shaded: "Shaded") -> None:
        """Keep the picture of a light that was just written, in half its size, for the sheet."""
        with self._stages.stage("sheet"):
            image = self._last_picture
            if image is None:
                relit = None if self._splats is None else self._relit.relit(shaded)
                image = self._painted(relit, shaded)
            self._last_picture = None
            if not self._on_sheet:
                self._on_sheet = [(name, _halved(each)) for name, each in self._before()]
                self._before_lights = len(self._on_sheet)
            light = shaded.light
            self._on_sheet.append((f"{light.name} {light.rotation_deg:g}°", _halved(image)))

    def write_sheet(self, folder: Path, last: int | None = None) -> str:
        """Write the sheet of all lights kept, or of the last so many: its name."""
        from .sheet import sheet

        first, lights = self._on_sheet[: self._before_lights], self._on_sheet[self._before_lights :]
        mesh_files.write_png(folder / SHEET, sheet(first + lights[-(last or len(lights)) :]))
        return SHEET

    def _before(self) -> list[tuple[str, NDArray[np.uint8]]]:
        """Names and pictures of what was captured and, where it was estimated, of its albedo, before plain grey; then
        of the lights that an estimate offered."""
        look = self._appearance
        self._picture = self._picture or self._new_picture(None)
        estimated = look.prior is not None and not look.as_captured and look.albedo is not None
        if self._splats is None:
            found = [(BEFORE[0], self._picture.of_vertices(look.captured, None, 1.0))]
        else:
            found = [(BEFORE[0], self._picture.of_splats(self._splats, None, 1.0))]
        if not estimated:
            return found
        found.append((BEFORE[1], self._albedo_picture(look.albedo, look.irradiance)))
        return [*found, *offered_pictures(self._relighter, look, self._albedo_picture)]

    def _albedo_picture(self, albedo: Any, irradiance: NDArray[np.float32]) -> NDArray[np.uint8]:
        """The picture of an albedo (V, 3), and of splats without a light (V, 3) that they were captured in."""
        if self._splats is None:
            return np.asarray(self._picture.of_vertices(albedo, None, 1.0))
        white = np.ones_like(irradiance)
        return np.asarray(self._picture.of_splats(self._bound().relit(irradiance, white), None, 1.0))

    def relit_splats(self, shaded: "Shaded") -> Splats:
        """The splats in the new light, row by row those of the source, in its frame."""
        return self._relit.relit(shaded)


def _halved(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A picture in half its size."""
    height, width = image.shape[0] // 2, image.shape[1] // 2
    blocks = image[: 2 * height, : 2 * width].reshape(height, 2, width, 2, 3).astype(np.float32)
    return np.asarray(np.rint(blocks.mean(axis=(1, 3))), np.uint8)
