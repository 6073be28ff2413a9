"""Draws the window behind its panel: the surface in the colours of the session, the captured surface, the sky."""

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkImageData, vtkPlane, vtkPolyData
from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper, vtkTexture, vtkWindowToImageFilter

from splat2mesh.scene.drawn import Drawn
from splat2mesh.scene.scene import Scene

from .camera import Orbit
from .quick import display_bytes
from .raster import SOFTWARE, Raster
from .splat_painter import SplatPainter

if TYPE_CHECKING:
    from ..insert.inserts import InsertedLight

BACKDROP = (0.075, 0.078, 0.088), (0.145, 0.150, 0.165)
"""Background of the scene without its sky, bottom and top: sRGB."""

DOME = 64, 128
"""Patches of the sky's sphere, up and around: directions within one are off by under 0.02 degrees."""

SKY_RADIUS = 1.1
"""Radius of the sky's sphere about the eye, over the distance of the farthest corner of the scene."""

MOVING_SAMPLES, RESTING_SAMPLES = 0, 8
"""Samples per pixel. Smooth edges double the time of software rendering, so only pictures at rest have them."""


class Stage:
    """Surface and sky in a VTK renderer. Colours are written in place: no geometry is sent twice."""

    def __init__(self, renderer: Any, scene: Scene) -> None:
        self._renderer = renderer
        self._drawn = Drawn(scene)
        shown = self._scene = self._drawn.scene
        points, cells = _geometry(shown.vertices, shown.faces)
        self._surface, self._colors, self._shown = _surface(points, cells, shown.colors_srgb.copy())
        self._captured, _, self._before = _surface(points, cells, shown.colors_srgb.copy())
        self._captured.VisibilityOff()
        self._planes = vtkPlane(), vtkPlane()
        self._sky, self._texture = _dome()
        self._sky_bytes: NDArray | None = None
        self._picture = vtkTexture()
        self._picture.SetColorModeToDirectScalars()
        self._picture.InterpolateOn()
        self._raster: Raster | None = None
        self._behind: Raster | None = None
        self._objects: _Objects | None = None
        self.splats = SplatPainter(scene)
        for actor in (self._surface, self._captured, self._sky):
            renderer.AddActor(actor)
        renderer.SetBackground(*BACKDROP[0])
        renderer.SetBackground2(*BACKDROP[1])
        renderer.GradientBackgroundOn()

    def color(self, colors: NDArray) -> None:
        """Show the surface in these sRGB bytes, (V, 3) uint8; cards of leaves take those of the hull around them."""
        self._shown[:] = self._drawn.values(colors)
        self._colors.Modified()

    def show_objects(self, inserted: "InsertedLight | None", exposure: float | None) -> None:
        """Show objects beside the surface, at an exposure; None for none."""
        if inserted is None or exposure is None:
            return
        known = self._objects
        if known is not None and known.light is inserted and known.exposure == exposure:
            return
        standing = inserted.standing
        colors = display_bytes(inserted.radiance, exposure)
        if known is None or known.light.standing is not standing:
            if known is not None:
                self._renderer.RemoveActor(known.actor)
            points, cells = _geometry(standing.vertices, standing.faces)
            actor, array, shown = _surface(points, cells, colors)
            self._renderer.AddActor(actor)
            self._raster = None  # of other triangles
        else:
            actor, array, shown = known.actor, known.array, known.shown
            shown[:] = colors
            array.Modified()
        self._objects = _Objects(inserted, exposure, actor, array, shown)

    def paint_sky(self, sky: NDArray, exposure: float) -> None:
        """Draw the sky, (H, W, 3) linear in canonical lat-long, unrotated."""
        height, width = sky.shape[:2]
        shown = display_bytes(np.ascontiguousarray(sky).reshape(-1, 3), exposure).reshape(height, width, 3)
        # One more texel on every side, beyond the seam and the poles.
        wide = np.concatenate([shown[:, -1:], shown, shown[:, :1]], axis=1)
        wide = np.concatenate([wide[:1], wide, wide[-1:]])
        image = vtkImageData()
        image.SetDimensions(width + 2, height + 2, 1)
        image.GetPointData().SetScalars(numpy_to_vtk(np.ascontiguousarray(wide[::-1]).reshape(-1, 3), deep=True))
        self._texture.SetInputData(image)
        edge = np.array([1.0 / (width + 2), 1.0 / (height + 2)])
        places = edge + _grid() * (1.0 - 2.0 * edge)
        self._sky.GetMapper().GetInput().GetPointData().SetTCoords(numpy_to_vtk(places.astype(np.float32), deep=True))
        self._sky_bytes = shown

    def turn_sky(self, angle_deg: float) -> None:
        """Turn the sky by an active Ry(+angle)."""
        self._sky.SetOrientation(0.0, angle_deg, 0.0)

    def show_sky(self, shown: bool) -> None:
        """Whether the sky shows behind the scene."""
        self._sky.SetVisibility(bool(shown) and self._sky_bytes is not None)

    def split(self, normal: NDArray | None = None, eye: NDArray | None = None) -> None:
        """Show the captured colours on the back side of the plane through `eye` with this `normal`; None: nowhere."""
        self._captured.SetVisibility(normal is not None)
        for actor, plane, sign in ((self._surface, self._planes[0], 1.0), (self._captured, self._planes[1], -1.0)):
            mapper = actor.GetMapper()
            if normal is None or eye is None:
                mapper.RemoveAllClippingPlanes()
                continue
            plane.SetOrigin(*eye)
            plane.SetNormal(*(sign * np.asarray(normal)))
            if mapper.GetNumberOfClippingPlanes() == 0:
                mapper.AddClippingPlane(plane)

    def software(self) -> bool:
        """Whether OpenGL draws on the CPU. Known once there is a window."""
        name = self._renderer.GetRenderWindow().ReportCapabilities().lower()
        lines = [line for line in name.splitlines() if "renderer string" in line]
        return any(kind in line for line in lines for kind in SOFTWARE)

    def rasterised(
        self, orbit: Orbit, size: tuple[int, int], split: float | None = None, angle_deg: float | None = None
    ) -> NDArray:
        """The picture as `look` and the rest would draw it, without smooth edges: (H, W, 3) uint8, bottom row first.

        split: place of the split line, or None. angle_deg: of the sky; None for the plain backdrop.
        """
        scene, objects = self._scene, self._objects
        vertices, faces, shown, before = scene.vertices, scene.faces, self._shown, self._before
        if objects is not None:
            standing = objects.light.standing
            vertices = np.concatenate([vertices, standing.vertices])
            faces = np.concatenate([faces, standing.faces + len(scene.vertices)])
            shown, before = np.concatenate([shown, objects.shown]), np.concatenate([before, objects.shown])
        if self._raster is None:
            self._raster = Raster(vertices, faces)
        self._raster.look(orbit, size)
        captured = None if split is None else (before, split)
        return self._raster.paint(shown, captured, self._sky_at(angle_deg), np.round(255.0 * np.array(BACKDROP)))

    def behind(self, orbit: Orbit, size: tuple[int, int], angle_deg: float | None = None) -> NDArray:
        """The background of the scene, (H, W, 3) uint8, bottom row first: the sky at an angle, or without."""
        if self._behind is None:
            self._behind = Raster(np.zeros((0, 3)), np.zeros((0, 3)))
        self._behind.look(orbit, size)
        nothing = np.zeros((0, 3), np.uint8)
        return self._behind.paint(nothing, None, self._sky_at(angle_deg), np.round(255.0 * np.array(BACKDROP)))

    def _sky_at(self, angle_deg: float | None) -> tuple[NDArray, float] | None:
        return None if angle_deg is None or self._sky_bytes is None else (self._sky_bytes, angle_deg)

    def show_picture(self, picture: NDArray | None) -> None:
        """Show these bytes, (H, W, 3) uint8 with the bottom row first, instead of surface and sky; None ends that.

        A smaller picture fills the window too.
        """
        objects = () if self._objects is None else (self._objects.actor,)
        actors = self._surface, self._captured, self._sky, *objects
        if picture is None:
            self._renderer.TexturedBackgroundOff()
            for actor in (self._surface, *objects):
                actor.VisibilityOn()
            return
        for actor in actors:
            actor.VisibilityOff()
        image = vtkImageData()
        image.SetDimensions(picture.shape[1], picture.shape[0], 1)
        image.GetPointData().SetScalars(numpy_to_vtk(np.ascontiguousarray(picture).reshape(-1, 3), deep=True))
        self._picture.SetInputData(image)
        self._renderer.SetBackgroundTexture(self._picture)
        self._renderer.TexturedBackgroundOn()

    def look(self, orbit: Orbit) -> None:
        """Look from an Orbit."""
        camera = self._renderer.GetActiveCamera()
        camera.SetPosition(*orbit.eye)
        camera.SetFocalPoint(*orbit.target)
        camera.SetViewUp(0.0, 1.0, 0.0)
        camera.UseHorizontalViewAngleOn()
        camera.SetViewAngle(orbit.fov_deg)
        low, high = np.reshape(self._surface.GetBounds(), (3, 2)).T
        farthest = float(np.linalg.norm(np.maximum(np.abs(orbit.eye - low), np.abs(orbit.eye - high))))
        self._sky.SetPosition(*orbit.eye)
        self._sky.SetScale(SKY_RADIUS * farthest)
        self._renderer.ResetCameraClippingRange(*self._surface.GetBounds())
        near, _ = camera.GetClippingRange()
        camera.SetClippingRange(min(near, farthest / 2.0), SKY_RADIUS**2 * farthest)


def pixels(render_window: Any) -> NDArray:
    """The picture of a window, (H, W, 3) uint8, top row first."""
    grabber = vtkWindowToImageFilter()
    grabber.SetInput(render_window)
    grabber.SetInputBufferTypeToRGB()
    grabber.ReadFrontBufferOff()
    grabber.ShouldRerenderOff()
    grabber.Update()
    image = grabber.GetOutput()
    width, height, _ = image.GetDimensions()
    return vtk_to_numpy(image.GetPointData().GetScalars()).reshape(height, width, 3)[::-1].copy()


def _grid() -> NDArray:
    """Positions (N, 2) in 0..1 of the dome's vertices in the unrotated image: to the right, and upwards."""
    right, up = np.meshgrid(np.linspace(0.0, 1.0, DOME[1] + 1), np.linspace(0.0, 1.0, DOME[0] + 1))
    return np.stack([right.ravel(), up.ravel()], axis=1)


def _dome() -> tuple[vtkActor, vtkTexture]:
    """A sphere with the sky on its inside, and its texture. Its vertices lie in the canonical directions.

    VTK's own skybox computes arc tangents for every pixel, which is slow in software, and its fixed lat-long lookup
    cannot be rotated.
    """
    u, v = _grid().T
    longitude, latitude = math.pi * (1.0 - 2.0 * u), math.pi * (v - 0.5)
    level = np.cos(latitude)
    corners = np.stack([np.sin(longitude) * level, np.sin(latitude), np.cos(longitude) * level], axis=1)
    row, column = (index.ravel() for index in np.indices(DOME))
    first = row * (DOME[1] + 1) + column
    faces = np.stack([first, first + 1, first + DOME[1] + 2, first + DOME[1] + 1], axis=1)
    points, cells = vtkPoints(), vtkCellArray()
    points.SetData(numpy_to_vtk(corners.astype(np.float32), deep=True))
    cells.SetData(4, numpy_to_vtkIdTypeArray(faces.astype(np.int64).ravel(), deep=True))
    mesh = vtkPolyData()
    mesh.SetPoints(points)
    mesh.SetPolys(cells)
    mapper = vtkPolyDataMapper()
    mapper.SetInputData(mesh)
    mapper.ScalarVisibilityOff()
    texture = vtkTexture()
    texture.InterpolateOn()
    texture.SetWrap(vtkTexture.ClampToEdge)
    texture.SetColorModeToDirectScalars()
    actor = vtkActor()
    actor.SetMapper(mapper)
    actor.SetTexture(texture)
    actor.GetProperty().LightingOff()
    actor.GetProperty().SetInterpolationToFlat()
    actor.VisibilityOff()
    actor.UseBoundsOff()
    return actor, texture


class _Objects(NamedTuple):
    """The displayed objects. shown: (W, 3) uint8, which `array` reads."""

    light: "InsertedLight"
    exposure: float
    actor: Any
    array: Any
    shown: NDArray[np.uint8]


def _geometry(vertices: NDArray, faces: NDArray) -> tuple[vtkPoints, vtkCellArray]:
    points = vtkPoints()
    points.SetData(numpy_to_vtk(np.ascontiguousarray(vertices, np.float32), deep=True))
    cells = vtkCellArray()
    corners = np.ascontiguousarray(faces).astype(np.int64).ravel()
    cells.SetData(3, numpy_to_vtkIdTypeArray(corners, deep=True))
    return points, cells


def _surface(points: Any, cells: Any, colors: NDArray) -> tuple[vtkActor, Any, NDArray]:
    """An actor that shows bytes (V, 3) as they are, the VTK array of the bytes, and the bytes that it reads."""
    mesh = vtkPolyData()
    mesh.SetPoints(points)
    mesh.SetPolys(cells)
    array = numpy_to_vtk(colors)  # shares the memory, which the caller keeps
    mesh.GetPointData().SetScalars(array)
    mapper = vtkPolyDataMapper()
    mapper.SetInputData(mesh)
    mapper.SetColorModeToDirectScalars()
    actor = vtkActor()
    actor.SetMapper(mapper)
    actor.GetProperty().LightingOff()
    actor.GetProperty().SetInterpolationToFlat()  # without light no normals are needed
    return actor, array, colors
