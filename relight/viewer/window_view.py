"""The attributes of a window that tools, keys and recordings use. Types only, so they import no window."""

from typing import TYPE_CHECKING, Protocol

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

    def look(self, orbit: "Orbit") -> None: ...

    def picture(self, panel: bool = True) -> NDArray: ...

    def recorded(self, note: str) -> None: ...
