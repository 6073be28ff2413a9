"""The worker's answers to a session: the newest results, whether they match the current wish, and what is missing."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .lighting import FinishedShading, LightWish, SessionLight, keys

if TYPE_CHECKING:
    from .worker import ProcessWorker


class Answers:
    """The wishes of a session and what its worker answered.

    wish: what the present state needs from the worker. available: the effects that there are. progress: (label,
    fraction or None) of the work under way, or None. message: the text to show, or "".
    """

    def __init__(self, worker: "ProcessWorker", wish: LightWish, available: frozenset[str]) -> None:
        self._worker, self.wish, self.available, self.message = worker, wish, available, ""
        self.progress: tuple[str, float | None] | None = None
        self._found: dict[str, tuple[Any, Any]] = {}  # newest results by kind
        self._asked: LightWish | None = None
        self._answered: tuple[LightWish, str] | None = None
        self._ended = ""

    @property
    def complete(self) -> bool:
        """Whether the worker has answered the wish, without failure."""
        return self._answered == (self.wish, "")

    @property
    def failure(self) -> str:
        """Why the worker cannot answer, or ""."""
        answered = self._answered
        return answered[1] if answered is not None and answered[0] == self._asked else self._ended

    @property
    def light(self) -> SessionLight | None:
        """The SessionLight loaded last, or None. It may be that of the state before."""
        return self._found["light"][1] if "light" in self._found else None

    @property
    def light_name(self) -> str | None:
        """Name of the environment that is shown, or None before the first."""
        return self._found["light"][0] if "light" in self._found else None

    @property
    def lit(self) -> FinishedShading | None:
        """The FinishedShading of the wish, or None until it arrives."""
        return self.current("shading")

    @property
    def error(self) -> float | None:
        """Relative L2 error of what is shown, on sampled vertices, or None while it is unknown."""
        return self.current("error")

    @property
    def called_for(self) -> frozenset[str]:
        """The effects that the plan calls for at this tolerance; all while it is unknown."""
        key, lit = self._found.get("shading", (None, None))
        return lit.effects if lit is not None and key[:4] == keys(self.wish)["shading"][:4] else self.available

    def ask(self) -> None:
        """Ask the worker for what is wished, once."""
        if self.wish != self._asked:
            # An older answer to the same wish does not apply to the new one.
            self._asked, self._answered = self.wish, None
            self._worker.submit(self.wish)

    def poll(self) -> bool:
        """Collect what the worker says, without waiting; return whether there are results."""
        news = False
        for kind, *rest in self._worker.poll():
            getattr(self, f"_take_{kind}")(*rest)
            news |= kind != "progress"
        return news

    def close(self) -> None:
        """End the worker."""
        self._worker.close()

    def _take_progress(self, label: str, fraction: float | None) -> None:
        self.progress = label, fraction

    def _take_result(self, kind: str, key: Any, payload: Any) -> None:
        if kind == "bounced":
            payload = np.ascontiguousarray(np.moveaxis(payload, 2, 0))  # a colour's coefficients beside each other
        self._found[kind] = key, payload
        self._answered = None  # messages after an answer belong to another wish
        if kind == "light" and payload.warning:
            self.message = payload.warning

    def _take_done(self, wish: LightWish) -> None:
        self._answered = wish, ""
        self.progress = None

    def _take_failed(self, wish: LightWish, text: str) -> None:
        self._answered = wish, text
        if wish == self._asked:
            self.message, self.progress = text, None

    def _take_ended(self, text: str) -> None:
        self.message, self.progress = text + ": only spherical harmonics from here on", None
        self._ended = text

    def current(self, kind: str) -> Any:
        """The payload of a kind if it belongs to the wish, else None."""
        key, payload = self._found.get(kind, (None, None))
        return payload if key is not None and key == keys(self.wish)[kind] else None

    def newest(self, kind: str) -> Any:
        """(key, payload) of the newest of a kind, or None."""
        return self._found.get(kind)

    @property
    def bounced(self) -> NDArray | None:
        """Bounced light per coefficient for the present albedo, (3, V, K'), or None; of a coarser level if need be."""
        key, payload = self._found.get("bounced", (None, None))
        return payload if key is not None and key[1:] == keys(self.wish)["bounced"][1:] else None
