"""The window of a session: mouse, keys, the loop, pictures and recordings."""

import os
import sys
import time
from ctypes.util import find_library
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkInteractionStyle import vtkInteractorStyleUser
from vtkmodules.vtkRenderingCore import vtkTexture

from splat2mesh.base.errors import InputError

from ..output.images import write_png
from ..output.kinds import PICTURE_SIZE
from ..output.preview import default_camera
from .camera import Orbit
from .controls import CONTROLS
from .mouse import Mouse
from .panel import Panel, bars_of
from .pointing import WindowView
from .recording import Recording, free_name
from .request import Turntable
from .session import Session
from .stage import Stage
from .worker import REST_SECONDS

SIZE = PICTURE_SIZE
TURN_SECONDS = 10.0  # of a light that turns by itself, once around
IDLE_SECONDS = 0.005  # between two polls of mouse and worker

_NO_DISPLAY = "no display: save a picture by `screenshot`, or start it in a notebook"


class Window(WindowView):
    """A PyVista window over a Session. `run` it, or call `tick` from a loop of your own.

    session: the Session. plotter: the pyvista.Plotter. orbit: the camera. note: a line of the window's own.
    Raises InputError where a display is missing.
    """

    def __init__(self, session: Session, size: tuple[int, int] = SIZE, off_screen: bool = False) -> None:
        pyvista = load_pyvista(off_screen)
        self.session: Session = session
        self.plotter = pyvista.Plotter(off_screen=off_screen, window_size=list(size), notebook=False, title="relight")
        self.plotter.render_window.SetMultiSamples(0)  # pictures are smooth; more take OpenGL four times as long
        self._glass = vtkTexture()
        self._glass.SetColorModeToDirectScalars()
        self.plotter.renderer.SetBackgroundTexture(self._glass)
        self.plotter.renderer.TexturedBackgroundOn()
        self._stage, self.note = Stage(session.scene), ""
        self.panel = Panel()
        camera = session.scene.preview_camera or default_camera(session.scene, size[0] / size[1])
        orbit = Orbit.of(camera, session.scene.vertices, session.scene.diagonal)
        bars = bars_of(size) if session.state.panel else (0.0, 0.0)
        self._home = self.orbit = orbit.in_window(size[0] / size[1], bars, session.scene.is_place)
        self._open, self._resting = True, False
        self._recording: Recording | None = None
        self._coming: Session | None = None  # in a captured light that was kept
        self.mouse: Mouse = Mouse(self)
        self._drawn: tuple | None = None
        self._picture: NDArray[np.uint8] = np.zeros((1, 1, 3), np.uint8)  # without the panel
        self.loop: Any = None  # of a notebook
        self._moved = self._panelled = self._ticked = -np.inf
        style = vtkInteractorStyleUser()
        style.AddObserver("CharEvent", lambda *_: None)  # or VTK's own keys would act too
        self.plotter.iren.style = style
        self.plotter.iren.clear_key_event_callbacks()
        interactor = self.plotter.iren.interactor
        for event, act in (
            ("KeyPressEvent", lambda: self.press_key(interactor.GetKeySym())),
            ("MouseMoveEvent", self.mouse.move),
            ("MouseWheelForwardEvent", lambda: self.look(self.orbit.nearer(1))),
            ("MouseWheelBackwardEvent", lambda: self.look(self.orbit.nearer(-1))),
            ("ExitEvent", lambda: self.quit(asked=True)),
            *((f"{button}Button{way}Event", self.mouse.press(button) if way == "Press" else self.mouse.release)
              for button in ("Left", "Middle", "Right") for way in ("Press", "Release")),
        ):  # fmt: skip
            interactor.AddObserver(event, lambda *_, act=act: act())
        self._interactor = interactor

    def run(self) -> None:
        """Show the window until it is closed."""
        self.tick()
        self.plotter.show(auto_close=False, interactive=False, interactive_update=True)
        self.plotter.iren.initialize()
        while self._open and not self._interactor.GetDone():
            self.plotter.iren.process_events()
            if not self.tick():
                time.sleep(IDLE_SECONDS)
        self.close()

    def tick(self) -> bool:
        """Run one round of the loop: collect results, advance motion, and draw a picture if it would differ.

        Return whether it drew one.
        """
        self._renew()
        session, now = self.session, self.session.clock()
        session.poll()
        if session.state.turning and self._recording is None:
            elapsed = min(now - self._ticked, 0.5) if np.isfinite(self._ticked) else 0.0
            session.change(angle_deg=session.state.angle_deg + 360.0 * elapsed / TURN_SECONDS)
        self._ticked = now
        if self._recording is not None:
            self._recording.tick()
        drawn = self._shown
        changed = drawn != self._drawn
        if changed:
            self._moved = now
        rests = now - self._moved > REST_SECONDS
        sharpens = rests and not self._resting
        if changed or sharpens:
            self._draw_scene(rests)
        if changed or now - self._panelled > REST_SECONDS:  # figures change continuously
            self._panelled = now
            changed |= self._draw_panel()
        elif sharpens:
            self._draw_panel()
        if not (changed or sharpens):
            return False
        self._render()
        return True

    def _renew(self) -> None:
        """Show the scene under a captured light that was kept, as soon as it is lit."""
        old, asked = self.session, None if self.session.hand is None else self.session.hand.relit()
        if asked is not None:
            self._drop_coming()
            self._coming = Session(asked, old.worker, old.clock)
            self._coming.follow(old)
        if self._coming is None or self._recording is not None:
            return
        self._coming.poll()
        if self._coming.answers.light is not None or self._coming.failure:
            self.session, self._coming = self._coming, None
            self.session.follow(old)
            old.close()
            self._drawn = None
            self.note = "relit under the captured light that you kept"

    def _drop_coming(self) -> None:
        if self._coming is not None:
            self._coming.close()
        self._coming = None

    @property
    def _shown(self) -> tuple:
        """What the picture depends on."""
        ground = self._stage.ground is not None and self._stage.ground.ready
        return self.session.revision, self.orbit, self.size, self.note, ground

    def finish(self, timeout: float = 600.0) -> None:
        """Wait until the picture is complete, and draw it with smooth edges."""
        self.session.finish(timeout)
        if self._stage.ground is not None:
            self._stage.ground.wait()
        self._draw_now()

    def picture(self, panel: bool = True) -> NDArray:
        """The picture of the window, (H, W, 3) uint8, with smooth edges, with or without the panel."""
        picture = self._draw_now(panel)
        if not panel:
            self._drawn = None  # the panel must reappear
        return picture

    def press_key(self, key: str) -> None:
        """Run the control of this VTK key symbol; other keys do nothing."""
        for control in CONTROLS:
            if control.key in (key, key.lower() if len(key) == 1 else key):
                self.note = ""
                control.act(self)
                return

    def reset(self) -> None:
        """Reset everything, the camera too."""
        self.session.reset()
        self.orbit, self.note = self._home, ""

    def save_picture(self, path: str | os.PathLike[str] | None = None) -> None:
        """Save the picture, without the panel, as a PNG: by default under the first free name in this folder."""
        path = Path(path) if path else free_name("relight_{:04d}.png")
        try:
            write_png(path, self.picture(panel=False))
        except (OSError, InputError) as error:
            self.note = f"cannot save {path}: {error}"
        else:
            self.note = f"saved {path.absolute()}"

    def record(self, path: str | os.PathLike[str] | None = None, turn: Turntable | None = None) -> None:
        """Start to record a rotation of the light, or stop and drop the recording that runs."""
        if self._recording is not None:
            self._recording.stop()
        else:
            self._recording = Recording(self, path, turn)

    def recorded(self, note: str) -> None:
        """Show the note of a recording that has ended."""
        self._recording, self.note = None, note

    @property
    def is_open(self) -> bool:
        """Whether it is still open."""
        return self._open

    @property
    def recording(self) -> bool:
        """Whether a recording runs."""
        return self._recording is not None

    def quit(self, asked: bool = False) -> None:
        """Close the window soon. During a recording, first warn that the film would be lost; close at the second
        call."""
        if self._recording is not None and not asked and not self._recording.asked:
            self._recording.asked, self.note = True, "recording a film: press q again to discard it"
            return
        self._open = False

    def close(self) -> None:
        """Close the window and end the worker; an incomplete film is dropped. A second call does nothing."""
        self._open = False
        if self._recording is not None:
            self._recording.stop("the window was closed")
        self.mouse.lamps.leave()
        self._drop_coming()
        if self._stage.ground is not None:
            self._stage.ground.close()
        self.session.close()
        self.plotter.close()

    def _draw_now(self, panel: bool = True) -> NDArray[np.uint8]:
        self.session.poll()
        self._draw_scene(True, wait=True)
        self._draw_panel(bare=not panel)
        return self._render()

    def _render(self) -> NDArray[np.uint8]:
        """Show scene and panel; return their picture."""
        picture = self.panel.over(self._picture)
        image = vtkImageData()
        image.SetDimensions(picture.shape[1], picture.shape[0], 1)
        image.GetPointData().SetScalars(numpy_to_vtk(picture[::-1].reshape(-1, 3), deep=True))
        self._glass.SetInputData(image)
        self.plotter.render_window.Render()
        return picture

    def _draw_panel(self, bare: bool = False) -> bool:
        return self.panel.draw(self.session, self.size, self.note, self.mouse.lamps.marks(), bare)

    def _draw_scene(self, rests: bool, wait: bool = False) -> None:
        """Draw the scene, as `Stage.picture`."""
        self._drawn, self._resting = self._shown, rests
        self._picture = self._stage.picture(self.session, self.orbit, self.size, rests, wait)


def load_pyvista(off_screen: bool) -> Any:
    """The module, set to the available kind of OpenGL. Raises InputError where that has no display."""
    screen = os.name == "nt" or os.uname().sysname == "Darwin"
    if not screen and not os.environ.get("DISPLAY"):
        if not off_screen:
            raise InputError(_NO_DISPLAY)
        # Else VTK tries X first, and complains on stderr.
        kind = "vtkEGLRenderWindow" if find_library("EGL") else "vtkOSOpenGLRenderWindow"
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", kind)
    import pyvista  # which takes a second

    return pyvista


def in_notebook() -> bool:
    """Whether this Python runs in a notebook's kernel."""
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    return shell is not None and hasattr(shell, "kernel")
