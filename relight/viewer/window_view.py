"""The attributes of a window that keys, mouse, tools and recordings use. Types only, so they import no window."""

from typing import TYPE_CHECKING, Any, Protocol

from numpy.typing import NDArray

if TYPE_CHECKING:
    from .camera import Orbit
    from .session import Session


class WindowView(Protocol):
    """A `window.Window`, which documents each of these."""

    note: str

    @property
    def session(self) -> "Session": ...

    @property
    def orbit(self) -> "Orbit": ...

    @property
    def size(self) -> tuple[int, int]: ...

    @property
    def mouse(self) -> Any: ...

    @property
    def panel(self) -> Any: ...

    @property
    def pointer(self) -> tuple[int, int]: ...

    @property
    def shift(self) -> bool: ...

    def look(self, orbit: "Orbit") -> None: ...

    def press_key(self, key: str) -> None: ...

    def picture(self, panel: bool = True) -> NDArray: ...

    def save_picture(self) -> None: ...

    def record(self) -> None: ...

    def recorded(self, note: str) -> None: ...

    def reset(self) -> None: ...

    def quit(self) -> None: ...
