"""Parts of the capture under the mouse: a click on a surface grows one, a slider says how far, a key keeps it."""

from typing import TYPE_CHECKING

from .part_bench import PartBench
from .pointing import surface_at, tried

if TYPE_CHECKING:
    from .window_view import WindowView

CLICK = "click what belongs to the part"


class PartTool:
    """Parts under the mouse and the keys of a Window."""

    def __init__(self, window: "WindowView") -> None:
        self._window = window

    @property
    def on(self) -> bool:
        """Whether a part is being made."""
        return self._window.session.state.parts and self._window.session.parts is not None

    def toggle(self) -> None:
        """Start or stop to make parts. The mesh shows meanwhile: parts grow on it."""
        session = self._window.session
        if session.parts is None:
            return
        starts = not session.state.parts
        session.change(parting=starts, placing=False, arranging=False, by_hand=False)
        self._window.note = CLICK if starts else ""

    def click(self, x: float, y: float) -> None:
        """Add what grows from the surface at a pixel."""
        hit = surface_at(self._window, self._bench.source, x, y)
        if hit is None:
            self._window.note = f"no surface there: {CLICK}"
            return
        tried(self._window, lambda: self._bench.add(hit[0]))
        self._tell()

    def reach_to(self, reach: float) -> None:
        """Set how far the part reaches."""
        self._bench.reach_to(reach)
        self._tell()

    def light_to(self, name: str, value: float) -> None:
        """Set a field of the light of the part."""
        self._bench.light_to(name, value)
        self._tell()

    def keep(self) -> None:
        """Write the part into the folder of the scene; show its name, or why not."""
        if not self.on:
            return

        def keep() -> None:
            option = "--part" if self._bench.made.light else "--only"
            name, folder = self._bench.keep()
            self._window.note = f"kept as {name}: relight {folder} {option} {name}"

        tried(self._window, keep)

    def _tell(self) -> None:
        if self._bench.clicks:
            count = int(self._bench.splats.sum())
            self._window.note = f"{count:,} splats in the part: click to add, z takes back, Return keeps it"

    @property
    def _bench(self) -> PartBench:
        bench = self._window.session.parts
        assert bench is not None
        return bench
