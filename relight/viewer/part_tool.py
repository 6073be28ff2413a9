"""Parts of the capture under the mouse: a click on a surface grows one, a slider says how far, a key keeps it."""

from .pointing import Tool

CLICK = "click what belongs to the part"


class PartTool(Tool):
    """Parts under the mouse and the keys of a Window. The mesh shows meanwhile: parts grow on it."""

    name = "parts"

    def toggle(self) -> None:
        """As of Tool."""
        super().toggle()
        self._window.note = CLICK if self.on else ""

    def click(self, x: float, y: float) -> None:
        """Add what grows from the surface at a pixel."""
        hit = self.surface_at(x, y)
        if hit is None:
            self._window.note = f"no surface there: {CLICK}"
            return
        self.tried(lambda: self.bench.add(self.in_splat(hit[0])))
        self._tell()

    def reach_to(self, reach: float) -> None:
        """Set how far the part reaches."""
        self.bench.reach_to(reach)
        self._tell()

    def light_to(self, name: str, value: float) -> None:
        """Set a field of the light of the part."""
        self.bench.light_to(name, value)
        self._tell()

    def keep(self) -> None:
        """Write the part into the folder of the scene; show its name, or why not."""
        if not self.on:
            return

        def keep() -> None:
            option = "--part" if self.bench.made.light else "--only"
            name, folder = self.bench.keep()
            self._window.note = f"kept as {name}: relight {folder} {option} {name}"

        self.tried(keep)

    def _tell(self) -> None:
        if self.bench.clicks:
            count = int(self.bench.splats.sum())
            self._window.note = f"{count:,} splats in the part: click to add, z takes back, Return keeps it"
