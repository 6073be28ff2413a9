"""What splats read of a session. Types only, so they import no session."""

from typing import TYPE_CHECKING, Protocol

from numpy.typing import NDArray

if TYPE_CHECKING:
    from ..engine.light_mix import LightBeside
    from ..insert.inserts import InsertedLight
    from .answers import Answers
    from .lamp_bench import LampBench
    from .lamp_board import LampBoard
    from .object_bench import ObjectBench
    from .state import State


class SessionView(Protocol):
    """A `session.Session`, which documents each of these."""

    @property
    def state(self) -> "State": ...

    @property
    def answers(self) -> "Answers": ...

    @property
    def mixture(self) -> "LightBeside | None": ...

    @property
    def bench(self) -> "LampBench | None": ...

    @property
    def lamps(self) -> "LampBoard | None": ...

    @property
    def objects(self) -> "ObjectBench | None": ...

    @property
    def objects_settled(self) -> bool: ...

    @property
    def inserted(self) -> "InsertedLight | None": ...

    def environment_radiance(self) -> NDArray | None: ...

    def exposure(self) -> float: ...

    def sky_exposure(self) -> float: ...
