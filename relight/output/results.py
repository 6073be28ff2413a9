"""Write the files of one light after another: meshes, splats, textures, a picture. Shared parts are made once."""

from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.beside import Beside
from splat2mesh.base.outputs import staged_file
from splat2mesh.scene.drawn import Drawn
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import Splats

from ..insert.inserts import ShadowedSplats
from . import mesh_files
from .around_files import AroundFiles
from .clean_files import CleanFiles
from .engine_files import EngineFiles
from .images import write_png
from .inserted_glb import inserted_glb
from .inserted_picture import PictureAsked, camera_of, with_objects
from .joined_splats import append_splats
from .kinds import FILES, OUTPUTS, PICTURE_SIZE, SHEET, written_by
from .live_files import LiveFiles
from .offered_lights import offered_pictures
from .pass_files import PassFiles
from .picture import RelitPicture
from .relit_splats import RelitSource
from .sheet import sheet
from .subject import FileWriter, LitFolder, WrittenScene
from .textures import SceneTextures

if TYPE_CHECKING:
    from ..engine.relighter import Shaded
    from ..insert.inserts import InsertedLight
    from ..light.environment import Environment

BEFORE = "captured", "albedo"
"""Labels of the pictures before the lights on the sheet."""

INSERTED = "inserted.glb", "inserted.png"
"""Files of inserted objects, and of a picture of them in the scene."""


WRITERS: dict[str, Callable[[WrittenScene, RelitSource], FileWriter]] = {
    "engines": EngineFiles,
    "around": AroundFiles,
    "passes": PassFiles,
    "clean": CleanFiles,
    "live": LiveFiles,
}
"""What writes the kinds that have files of their own, in this order."""


class Results:
    """Writes the results of a scene, light after light."""

    def __init__(self, written: WrittenScene) -> None:
        self._written, self._relit, self.shown = written, RelitSource(written), written.shown
        self._scene, self._stages, self._splats = written.scene, written.stages, written.source
        asked = written.asked
        # What is written as a splat is shown too.
        self._kinds = {*asked.kinds, *(["png"] if "splat" in asked.kinds else [])}
        self._shows_relit = any(OUTPUTS[kind].relit for kind in self._kinds)
        self._textures = SceneTextures(written, self._relit)
        self._others: list[FileWriter] = [self._textures] if asked.baked else []
        for name, make in WRITERS.items():
            if {*written_by(name)} & self._kinds or (name == "engines" and asked.live_mesh):
                self._others.append(make(written, self._relit))
        self._picture: Any = None
        self._last_picture: NDArray[np.uint8] | None = None
        self._on_sheet: list[tuple[str, NDArray[np.uint8]]] = []
        self._before_lights = 0

    def write(self, folder: Path, shaded: "Shaded") -> tuple[list[str], dict[str, Any]]:
        """Fill an existing folder: (names of the files, further entries of the report)."""
        names = [each.file for kind, each in OUTPUTS.items() if kind in self._kinds and not each.writer]
        facts: dict[str, Any] = {}
        with ExitStack() as begun:
            glb = splats = None
            if "glb" in self._kinds:
                facts["clipped_vertices"] = 0
                glb = begun.enter_context(self._begin_glb(folder / FILES["glb"], self.shown(shaded)))
            self._write_vertices(folder, self.shown(shaded))
            relit = self._relit.relit(shaded) if self._splats is not None and self._shows_relit else None
            into = LitFolder(folder, shaded, relit, facts)
            if "splat" in self._kinds and relit is not None:
                splats = begun.enter_context(Beside(partial(self._relit.write, folder, relit)))
                if shaded.inserted is not None:
                    splats.result()  # objects are added to it
            others = [] if shaded.inserted is None else self._write_inserted(into)
            others += [name for writer in self._others for name in writer.write(into)]
            if "png" in self._kinds:
                self._write_preview(into)
            if glb is not None:
                facts["clipped_vertices"] = glb.result()
            return names + ([] if splats is None else splats.result()) + others, facts

    def _write_vertices(self, folder: Path, shaded: "Shaded") -> None:
        """Write the results that have a value for each vertex."""
        radiance = shaded.shading.radiance
        with self._stages.stage("write"):
            if "ply" in self._kinds:
                mesh_files.write_ply(folder / FILES["ply"], self._scene, radiance, shaded.exposure)
            if "npy" in self._kinds:
                mesh_files.write_npy(folder / FILES["npy"], self._scene, radiance)

    def _write_preview(self, into: LitFolder) -> None:
        with self._stages.stage("preview"):
            self._last_picture = self.painted(into.relit, into.shaded)
            write_png(into.path / FILES["png"], self._last_picture)
        shown = "splat" if into.relit is not None else "texture" if self._shows_texture else "mesh"
        into.facts["preview"] = {"shows": shown, "camera": self._picture.camera}

    def _begin_glb(self, path: Path, shaded: "Shaded") -> Beside[int]:
        """Begin to write relit.glb beside other work, in its texture where the scene has one: the number of vertices
        that are clipped."""
        radiance, exposure, textured = shaded.shading.radiance, shaded.exposure, not self._textures.shows_vertices
        placed = self._written.lamps(shaded.light, exposure)
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
        return bool(self._written.asked.baked) and self._textures.is_whole

    def _write_inserted(self, into: LitFolder) -> list[str]:
        """Write the lit inserted objects, and a picture of them in the scene: names of the files."""
        shaded, relit, names = into.shaded, into.relit, []
        with self._stages.stage("write"):
            content = inserted_glb(shaded.inserted, shaded.exposure)
            if content:
                names.append(INSERTED[0])
                with staged_file(into.path / INSERTED[0]) as staging:
                    staging.write_bytes(content)
            if "splat" in self._kinds and relit is not None:
                splats = shaded.inserted.splats_put_in(shaded.exposure)
                if splats is not None:
                    append_splats(into.path / FILES["splat"], splats, relit.facts)
        if relit is None:
            return names
        with self._stages.stage("preview"):
            picture = self._new_picture(camera_of(shaded.inserted, self._scene))
            write_png(into.path / INSERTED[1], self._of_splats(picture, relit, shaded))
        return [*names, INSERTED[1]]

    def object_painter(
        self, shaded: "Shaded", poses: "list[InsertedLight]"
    ) -> "Callable[[InsertedLight], NDArray[np.uint8]]":
        """The function that draws moving objects under a light: splats if there are any, else the mesh.

        shaded: with the objects in any pose. poses: some of those to come."""
        points = np.concatenate([pose.standing.vertices for pose in poses])
        camera = camera_of(poses[len(poses) // 2], self._scene, points)
        light = shaded.sky
        radiance = shaded.shading.radiance / shaded.inserted.ratio
        if self._splats is None:
            return lambda pose: self._mesh_with(pose, radiance, camera, light, shaded.exposure)
        bound = ShadowedSplats(poses, self._relit.without_objects(shaded))
        picture = self._new_picture(camera)

        def drawn(pose: "InsertedLight") -> NDArray[np.uint8]:
            return self._of_splats(picture, bound.under(pose), shaded._replace(inserted=pose))

        return drawn

    def _mesh_with(
        self,
        pose: "InsertedLight",
        radiance: NDArray[np.float32],  # (V, 3) of the scene without the objects
        camera: dict[str, Any],
        light: "Environment | None",
        exposure: float,
    ) -> NDArray[np.uint8]:
        """A picture of the mesh with objects, and what these change of its light."""
        standing, drawn = pose.standing, Drawn(self._scene)
        colors = np.zeros(standing.vertices.shape, np.uint8)
        objects = Mesh(standing.vertices, standing.normals, standing.faces, colors)
        both = np.concatenate([drawn.colors(radiance * pose.ratio), pose.radiance])
        frame, capture = self._scene.scene_from_splat, self._scene.capture
        shown = Scene([*drawn.scene.chunks, objects], scene_from_splat=frame, capture=capture)
        picture = RelitPicture(shown, camera, PICTURE_SIZE)
        return np.asarray(picture.of_vertices(both, light, exposure, inset=False), np.uint8)

    def _of_splats(self, picture: Any, relit: Splats, shaded: "Shaded") -> NDArray[np.uint8]:
        """A picture of relit splats with the inserted objects."""
        light = self._behind(shaded)
        if shaded.inserted is not None:
            relit = with_objects(relit, shaded.inserted, PictureAsked(self._scene, picture.view, shaded.exposure))
        return picture.of_splats(relit, light, shaded.exposure * shaded.backdrop)

    def _new_picture(self, camera: dict[str, Any] | None) -> RelitPicture:
        """A RelitPicture of the scene; without a camera, by its own."""
        return RelitPicture(self._scene, camera, PICTURE_SIZE, indoors=self._written.appearance.room is not None)

    def painted(self, relit: Splats | None, shaded: "Shaded") -> NDArray[np.uint8]:
        """The picture, (H, W, 3) uint8: of the relit splats, else of the texture, else of the mesh, as there are."""
        light = self._behind(shaded)
        exposure, behind = shaded.exposure, shaded.exposure * shaded.backdrop
        self._picture = self._picture or self._new_picture(None)
        if relit is not None:
            return self._of_splats(self._picture, relit, shaded)
        mesh = self.shown(shaded)
        if self._shows_texture:
            return self._picture.of_texture(*self._textures.painter(mesh), light, behind)
        return self._picture.of_vertices(mesh.shading.radiance, light, exposure)

    def _behind(self, shaded: "Shaded") -> "Environment | None":
        """The light that pictures show behind the scene; None where all but a part keeps the captured light."""
        part = self._written.part
        return shaded.sky if part is None or part.kept else None

    def add_to_sheet(self, shaded: "Shaded") -> None:
        """Keep the picture of a light that was just written, in half its size, for the sheet."""
        with self._stages.stage("sheet"):
            image = self._last_picture
            if image is None:
                relit = None if self._splats is None else self._relit.relit(shaded)
                image = self.painted(relit, shaded)
            self._last_picture = None
            if not self._on_sheet:
                self._on_sheet = [(name, _halved(each)) for name, each in self._before()]
                self._before_lights = len(self._on_sheet)
            light = shaded.light
            self._on_sheet.append((f"{light.name} {light.rotation_deg:g}°", _halved(image)))

    def write_sheet(self, folder: Path, last: int | None = None) -> str:
        """Write the sheet of all lights kept, or of the last so many: its name."""
        first, lights = self._on_sheet[: self._before_lights], self._on_sheet[self._before_lights :]
        write_png(folder / SHEET, sheet(first + lights[-(last or len(lights)) :]))
        return SHEET

    def _before(self) -> list[tuple[str, NDArray[np.uint8]]]:
        """Names and pictures of what was captured and, where it was estimated, of its albedo, before plain grey; then
        of the lights that an estimate offered."""
        look = self._written.appearance
        self._picture = self._picture or self._new_picture(None)
        estimated = look.prior is not None and not look.as_captured and look.albedo is not None
        if self._splats is None:
            found = [(BEFORE[0], self._picture.of_vertices(look.captured, None, 1.0))]
        else:
            found = [(BEFORE[0], self._picture.of_splats(self._splats, None, 1.0))]
        if not estimated:
            return found
        found.append((BEFORE[1], self._albedo_picture(look.albedo, look.irradiance)))
        return [*found, *offered_pictures(self._written.relighter, look, self._albedo_picture)]

    def _albedo_picture(self, albedo: Any, irradiance: NDArray[np.float32]) -> NDArray[np.uint8]:
        """The picture of an albedo (V, 3), and of splats without a light (V, 3) that they were captured in."""
        if self._splats is None:
            return np.asarray(self._picture.of_vertices(albedo, None, 1.0))
        white = np.ones_like(irradiance)
        return np.asarray(self._picture.of_splats(self._written.binding().relit(irradiance, white), None, 1.0))

    @property
    def source(self) -> RelitSource:
        """The splats of the scene, in any of its lights."""
        return self._relit

    def relit_splats(self, shaded: "Shaded") -> Splats:
        """The splats in the new light, row by row those of the source, in its frame."""
        return self._relit.relit(shaded)


def _halved(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A picture in half its size."""
    height, width = image.shape[0] // 2, image.shape[1] // 2
    blocks = image[: 2 * height, : 2 * width].reshape(height, 2, width, 2, 3).astype(np.float32)
    return np.asarray(np.rint(blocks.mean(axis=(1, 3))), np.uint8)
