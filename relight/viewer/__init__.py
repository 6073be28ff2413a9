"""An interactive session: a window in which to turn, compare and switch the light.

    from relight.viewer import view
    view(scene, "sunset")

Modules: `session` state and light, `answers` what the worker said, `worker` and `lighting` the heavy work in a process
of its own, `modes` what colours the surface, `splats` and `splat_painter` relit splats in its place, `controls` the
keys, `mouse` the mouse, `window`, `stage`, `panel` and `camera` what VTK draws, `recording` films. Lamps that are put
in: `editing` what Python calls, `lamp_board` undo, `lamp_bench` their light, `lamp_source` the engine behind it,
`lamp_tool` the hand on them. Objects: `object_bench`, `object_light`, `object_source` and `object_tool` likewise.
"""

import os
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import InputError
from splat2mesh.scene.foreign import AnyScene, as_scene

from ..options import LightingOptions

if TYPE_CHECKING:
    from ..light.environment import Environment
    from ..transfer.store import Cache
    from .lamp_source import LampSource
    from .mixture import SessionMixture
    from .object_source import ObjectSource
    from .session import Session
    from .splats import SplatSource

__all__ = ["record_turntable", "serve", "view"]


def view(
    scene: AnyScene,  # as of Relighter
    environment: "Environment | str | os.PathLike[str]" = "studio",  # or what Environment.load takes
    options: LightingOptions | str | None = None,
    *,
    albedos: Mapping[str, NDArray[np.floating] | None] | None = None,  # name -> (V, 3) linear or None for white
    environments_folder: str | os.PathLike[str] | None = None,  # its .exr and .hdr files can be chosen too
    screenshot: str | os.PathLike[str] | None = None,  # .png, .jpg or .webp to write instead of opening a window
    off_screen: bool = False,  # no window: returns the Window for a loop of its own
    size: tuple[int, int] | None = None,  # width, height
    exposure: float | None = None,  # display value per unit of radiance
    state: Mapping[str, Any] | None = None,  # fields of `session.State` to start with
    cache: "Cache | None" = None,  # as of Relighter
    lamps: Mapping[str, NDArray[np.floating]] | None = None,  # name of an albedo -> (V, 3) radiance by a room's lamps
    lamps_known: bool = True,  # whether those can be told from other light, and dimmed
    mixture: "SessionMixture | None" = None,  # captured light and placed lamps
    lamp_source: "LampSource | None" = None,  # what lights lamps that are put in; without it none can be
    object_source: "ObjectSource | None" = None,  # what lights objects that are put in; None without any
    splats: "SplatSource | None" = None,  # what the scene was made of: shown, relit, in place of the mesh
    panel: bool = False,  # whether the panel is in the screenshot
    **wishes: Any,
) -> Any:
    """Open the session. Returns when it is closed; in a notebook at once, with what shows it.

    options, wishes: LightingOptions and fields of them, as of Relighter; a session has a tolerance and no budget. The
    first of the albedos is shown first. With `screenshot` no window opens: the picture is written when its light is
    complete. Raises InputError for input that cannot be used, a missing PyVista and a missing display.
    """
    from ..output.mesh_files import check_image, write_image
    from .window import SIZE, Window, in_notebook, load_pyvista

    if screenshot:
        check_image(screenshot)
    notebook = in_notebook() and not (screenshot or off_screen)
    off_screen = bool(off_screen or screenshot or notebook)
    load_pyvista(off_screen)
    options = LightingOptions.of(options, **wishes)
    more: dict[str, Any] = {
        "cache": cache,
        "lamps": lamps,
        "lamps_known": lamps_known,
        "splats": splats,
        "mixture": mixture,
    }
    more |= {"lamp_source": lamp_source, "object_source": object_source}
    session = _session(scene, environment, options, albedos, environments_folder, exposure, state, **more)
    if screenshot and not panel:
        session.change(panel=False)  # which leaves the whole of the picture to the scene
    try:
        window = Window(session, size or SIZE, off_screen)
        if notebook:
            from .notebook import show_widget

            return show_widget(window)
        if screenshot:
            window.finish()
            write_image(screenshot, window.picture(panel))
        elif off_screen:
            return window
        else:
            window.run()
    except BaseException:
        session.close()
        raise
    window.close()


def serve(
    scene: AnyScene,
    environment: "Environment | str | os.PathLike[str]" = "studio",
    options: LightingOptions | str | None = None,
    *,
    port: int = 0,  # any free one
    announce: Callable[[str], None] = lambda url: None,  # told the address, with its token, once it can be opened
    albedos: Mapping[str, NDArray[np.floating] | None] | None = None,
    environments_folder: str | os.PathLike[str] | None = None,
    size: tuple[int, int] | None = None,
    exposure: float | None = None,
    state: Mapping[str, Any] | None = None,
    cache: "Cache | None" = None,
    lamps: Mapping[str, NDArray[np.floating]] | None = None,
    lamps_known: bool = True,
    mixture: "SessionMixture | None" = None,  # captured light and placed lamps
    lamp_source: "LampSource | None" = None,  # what lights lamps that are put in; without it none can be
    object_source: "ObjectSource | None" = None,  # what lights objects that are put in; None without any
    splats: "SplatSource | None" = None,
    **wishes: Any,
) -> None:
    """The session in a browser of this machine, until it is quit there or interrupted here. Arguments as of `view`.

    Raises InputError as `view` does, for a missing trame and for a port that is taken.
    """
    from .notebook import serve as served
    from .window import SIZE, Window, load_pyvista

    load_pyvista(True)
    options = LightingOptions.of(options, **wishes)
    more: dict[str, Any] = {
        "cache": cache,
        "lamps": lamps,
        "lamps_known": lamps_known,
        "splats": splats,
        "mixture": mixture,
    }
    more |= {"lamp_source": lamp_source, "object_source": object_source}
    session = _session(scene, environment, options, albedos, environments_folder, exposure, state, **more)
    try:
        served(Window(session, size or SIZE, off_screen=True), port, announce)
    finally:
        session.close()


def record_turntable(
    path: str | os.PathLike[str],  # .gif, or .mp4 where imageio-ffmpeg is installed
    scene: AnyScene,
    environment: "Environment | str | os.PathLike[str]" = "studio",
    options: LightingOptions | str | None = None,
    *,
    frames: int = 72,
    what: str = "light",  # or "camera": what turns
    panel: bool = False,  # whether the panel is in the film
    overwrite: bool = False,
    albedos: Mapping[str, NDArray[np.floating] | None] | None = None,
    size: tuple[int, int] = (960, 720),
    exposure: float | None = None,
    state: Mapping[str, Any] | None = None,
    cache: "Cache | None" = None,
    lamps: Mapping[str, NDArray[np.floating]] | None = None,
    lamps_known: bool = True,
    mixture: "SessionMixture | None" = None,  # captured light and placed lamps
    lamp_source: "LampSource | None" = None,  # what lights lamps that are put in; without it none can be
    object_source: "ObjectSource | None" = None,  # what lights objects that are put in; None without any
    splats: "SplatSource | None" = None,
    **wishes: Any,
) -> None:
    """Film a full turn off screen, every picture with its suns and bounces. Arguments as of `view`.

    Raises InputError as `view` does, and for a film that cannot be written.
    """
    import time

    from .recording import check_film
    from .window import IDLE_SECONDS, Window, load_pyvista

    check_film(path, frames, what, overwrite)
    load_pyvista(True)
    options = LightingOptions.of(options, **wishes)
    more: dict[str, Any] = {
        "cache": cache,
        "lamps": lamps,
        "lamps_known": lamps_known,
        "splats": splats,
        "mixture": mixture,
    }
    more |= {"lamp_source": lamp_source, "object_source": object_source}
    session = _session(scene, environment, options, albedos, None, exposure, state, **more)
    try:
        window = Window(session, size, off_screen=True)
        window.record(path, frames=frames, what=what, panel=panel, overwrite=overwrite)
        while window.recording:
            if not window.tick():
                time.sleep(IDLE_SECONDS)
        if window.note.startswith("recording dropped"):
            raise InputError(window.note)
    finally:
        session.close()
    window.close()


def _session(
    scene: AnyScene,
    environment: "Environment | str | os.PathLike[str]",
    options: LightingOptions,
    albedos: Mapping[str, NDArray[np.floating] | None] | None,
    folder: str | os.PathLike[str] | None,
    exposure: float | None,
    state: Mapping[str, Any] | None,
    **more: Any,
) -> "Session":
    from .session import Session
    from .state import choices_of

    session = Session(as_scene(scene), choices_of(environment, folder), options, albedos, exposure, **more)
    if state:
        session.change(**state)
    return session
