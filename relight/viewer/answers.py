"""The worker's answers to a session: the newest results, whether they match the current wish, and what is missing."""

from abc import ABC, abstractmethod
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..transfer.settings import BOUNCES, EFFECTS, SHADOWS, VOLUME
from .lighting import ConvergedLight, FinishedShading, LightWish, SessionLight, keys


class LightWorker(Protocol):
    """The interface that answers the wishes of a session: `worker.ProcessWorker`, or another implementation."""

    def submit(self, wish: LightWish) -> None:
        """Request the newest wish; unfinished work of an older one is dropped."""

    def poll(self) -> list[tuple[Any, ...]]:
        """Messages since the last call."""

    def close(self) -> None:
        """End it."""


class Answers(ABC):
    """The wishes of a session and their results. A Session defines its wish.

    progress: (label, fraction or None) of the work under way, or None. message: the text to show, or "".
    """

    available: frozenset[str]

    def __init__(self, worker: LightWorker) -> None:
        self._worker, self.message = worker, ""
        self.progress: tuple[str, float | None] | None = None
        self._found: dict[str, tuple[Any, Any]] = {}  # newest results by kind
        self._asked: LightWish | None = None
        self._answered: tuple[LightWish, str] | None = None
        self._ended = ""

    @property
    @abstractmethod
    def wish(self) -> LightWish:
        """The results that the current state needs from the worker."""

    @property
    @abstractmethod
    def effects(self) -> frozenset[str]:
        """The effects that take part."""

    @property
    def lamps_settled(self) -> bool:
        """Whether the light of added lamps is complete."""
        return True

    @property
    def lamps_failure(self) -> str:
        """Why it cannot be computed, or ""."""
        return ""

    @property
    def objects_settled(self) -> bool:
        """Whether the light of inserted objects is complete."""
        return True

    @property
    def objects_failure(self) -> str:
        """Why it cannot be computed, or ""."""
        return ""

    @property
    def answered(self) -> bool:
        """Whether the worker has answered the present state, and lamps are lit."""
        return self._answered == (self.wish, "") and self.lamps_settled

    @property
    def settled(self) -> bool:
        """Whether the worker has answered the present state in full, and nothing newer has come in since."""
        return self.answered and self.objects_settled

    @property
    def failure(self) -> str:
        """Why the worker cannot answer the present state, or ""."""
        answered = self._answered
        answer = answered[1] if answered is not None and answered[0] == self._asked else self._ended
        return answer or self.lamps_failure or self.objects_failure

    @property
    def light(self) -> SessionLight | None:
        """The SessionLight loaded last, or None. It may be that of the state before."""
        return self._found["light"][1] if "light" in self._found else None

    @property
    def light_name(self) -> str | None:
        """Name of the environment that is shown, or None before the first."""
        return self._found["light"][0] if "light" in self._found else None

    @property
    def complete(self) -> bool:
        """Whether suns, bounces and shadows are all in what `radiance` returns."""
        return self._lit() is not None and self.lamps_settled

    @property
    def lit(self) -> FinishedShading | None:
        """The shown FinishedShading, or None until it arrives."""
        return self._lit()

    @property
    def error(self) -> float | None:
        """Relative L2 error of what is shown, on sampled vertices, or None while it is unknown."""
        return self._current("error")

    @property
    def called_for(self) -> frozenset[str]:
        """The effects that the plan calls for at this tolerance; all while it is unknown."""
        key, lit = self._found.get("shading", (None, None))
        return lit.effects if lit is not None and key[:3] == keys(self.wish)["shading"][:3] else self.available

    @property
    def reference(self) -> ConvergedLight | None:
        """The ConvergedLight of the present light, or None."""
        return self._current("reference")

    @property
    def waiting_for(self) -> str:
        """The effects still missing in the picture, in words; "" when it is complete."""
        if self.complete or self.light is None:
            return ""
        if self._lit() is not None:
            return "the light of the lamps"
        missing = [name for name in EFFECTS if name in self.effects & self.called_for - {VOLUME}]  # with the shadows
        if SHADOWS in missing and "transfer" in self._found:
            missing.remove(SHADOWS)
            if BOUNCES in missing and self._bounced() is not None:
                missing = [name for name in missing if name != BOUNCES] or ["the last of the bounces"]
        if not missing:
            return "the light"
        return " and ".join([", ".join(missing[:-1]), missing[-1]] if len(missing) > 1 else missing)

    def _ask(self) -> None:
        wish = self.wish
        if wish != self._asked:
            self._asked, self._answered = wish, None  # an older answer to the same wish does not apply to the new one
            self._worker.submit(wish)

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

    def _current(self, kind: str) -> Any:
        """The payload of a kind if it belongs to the present wish, else None."""
        key, payload = self._found.get(kind, (None, None))
        return payload if key is not None and key == keys(self.wish)[kind] else None

    def _lit(self) -> FinishedShading | None:
        return self._current("shading")

    def _bounced(self) -> NDArray | None:
        """Bounced light per coefficient for the present albedo, (3, V, K'), or None; of a coarser level if need be."""
        key, payload = self._found.get("bounced", (None, None))
        return payload if key is not None and key[1:] == keys(self.wish)["bounced"][1:] else None
