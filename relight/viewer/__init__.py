"""An interactive session: a window in which to turn, compare and switch the light.

    from relight.viewer import view
    view(scene, "sunset")

`session` holds what the user set; `worker` and `lighting` do the heavy work in a process of its own;
`window`, `stage` and `panel` draw. What a hand changes (lamps, objects, the captured light) has a tool under the mouse,
a bench for its light while it changes, and the engine behind it in `sources`.
"""

import os
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from splat2mesh.base.errors import InputError
from splat2mesh.scene.foreign import AnyScene

from ..options import LightingOptions
from .request import SessionRequest, Turntable
from .waiting import Served

if TYPE_CHECKING:
    from ..light.environment import Environment
    from .window import Window

__all__ = ["SessionRequest", "Turntable", "record_turntable", "serve", "view"]


def view(
    scene: "AnyScene | SessionRequest",  # as of Relighter, or the whole request
    environment: "Environment | str | os.PathLike[str]" = "studio",  # or what Environment.load takes
    options: LightingOptions | str | None = None,
    *,
    screenshot: str | os.PathLike[str] | None = None,  # .png, .jpg or .webp to write instead of opening a window
    off_screen: bool = False,  # no window: returns the Window for a loop of its own
    size: tuple[int, int] | None = None,  # width, height
    panel: bool = False,  # whether the panel is in the screenshot
    **wishes: Any,
) -> Any:
    """Open the session and return when it is closed. In a notebook, return a widget at once.

    wishes: fields of SessionRequest, such as albedos and exposure, and of LightingOptions, such as tolerance, side by
    side. With `screenshot` no window opens: the picture is written when its light is complete. Raises InputError for
    input that cannot be used, and for a missing display.
    """
    from ..output.images import check_image, write_image
    from .window import in_notebook

    if screenshot:
        check_image(screenshot)
    notebook = in_notebook() and not (screenshot or off_screen)
    hidden = bool(off_screen or screenshot or notebook)
    request = SessionRequest.of(scene, environment, options, **wishes)
    window = _window(request, size, hidden, panel or not screenshot)
    if off_screen and not screenshot:
        return window
    try:
        if notebook:
            from .notebook import show_widget

            return show_widget(window)
        if screenshot:
            window.finish()
            write_image(screenshot, window.picture(panel))
        else:
            window.run()
    except BaseException:
        window.close()
        raise
    window.close()


def _window(asked: SessionRequest, size: tuple[int, int] | None, off_screen: bool, panel: bool = True) -> "Window":
    """The Window of a request. Raises InputError as `view` does."""
    from .session import Session
    from .window import SIZE, Window, load_pyvista

    load_pyvista(off_screen)
    session = Session(asked)
    session.change(panel=panel and session.state.panel)
    return Window(session, size or SIZE, off_screen)


def serve(
    scene: "AnyScene | SessionRequest",
    environment: "Environment | str | os.PathLike[str]" = "studio",
    options: LightingOptions | str | None = None,
    *,
    port: int | Served = 0,  # 0 for any free one
    announce: Callable[[str], None] = lambda url: None,  # receives the address, with its token, once it can be opened
    size: tuple[int, int] | None = None,
    **wishes: Any,
) -> None:
    """The session in a browser of this machine, until it is quit there or interrupted here. Arguments as of `view`.

    Raises InputError as `view` does, for a missing trame and for a port that is taken.
    """
    from .notebook import serve as served

    place = port if isinstance(port, Served) else Served.at(port)
    window = _window(SessionRequest.of(scene, environment, options, **wishes), size, True)
    try:
        served(window, place, announce)
    finally:
        window.close()


def record_turntable(
    path: str | os.PathLike[str],  # .gif, or .mp4 where imageio-ffmpeg is installed
    scene: "AnyScene | SessionRequest",
    environment: "Environment | str | os.PathLike[str]" = "studio",
    options: LightingOptions | str | None = None,
    turn: Turntable | None = None,
    **wishes: Any,
) -> None:
    """Film a full turn off screen, every picture with its suns and bounces. Arguments as of `view`.

    wishes: fields of Turntable too, such as frames. Raises InputError as `view` does, and for a film that cannot be
    written.
    """
    from .recording import check_film
    from .window import IDLE_SECONDS

    turn, wishes = Turntable.of(turn, wishes)
    check_film(path, turn)
    window = _window(SessionRequest.of(scene, environment, options, **wishes), turn.size, True)
    try:
        window.record(path, turn)
        while window.recording:
            if not window.tick():
                time.sleep(IDLE_SECONDS)
        if window.note.startswith("recording dropped"):
            raise InputError(window.note)
    finally:
        window.close()
