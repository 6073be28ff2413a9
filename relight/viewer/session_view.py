"""The attributes of a session that modes, splats and objects read. Types only, so they import no session."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Protocol

from numpy.typing import NDArray

if TYPE_CHECKING:
    from splat2mesh.scene.scene import Scene

    from ..engine.light_mix import LightBeside
    from ..insert.inserts import InsertedLight
    from .hand_bench import HandBench
    from .lamp_bench import LampBench
    from .lamp_board import LampBoard
    from .lighting import ConvergedLight, SessionLight
    from .object_bench import ObjectBench
    from .state import State


class SessionView(Protocol):
    """A `session.Session`, which documents each of these."""

    @property
    def scene(self) -> "Scene": ...

    @property
    def state(self) -> "State": ...

    @property
    def albedos(self) -> Mapping[str, NDArray | None]: ...

    @property
    def environments(self) -> Mapping[str, Any]: ...

    @property
    def effects(self) -> frozenset[str]: ...

    @property
    def light(self) -> "SessionLight | None": ...

    @property
    def light_name(self) -> str | None: ...

    @property
    def reference(self) -> "ConvergedLight | None": ...

    @property
    def mixture(self) -> "LightBeside | None": ...

    @property
    def bench(self) -> "LampBench | None": ...

    @property
    def board(self) -> "LampBoard | None": ...

    @property
    def hand(self) -> "HandBench | None": ...

    @property
    def objects(self) -> "ObjectBench | None": ...

    @property
    def objects_settled(self) -> bool: ...

    @property
    def inserted(self) -> "InsertedLight | None": ...

    def radiance(self) -> NDArray | None: ...

    def plain_radiance(self) -> NDArray | None: ...

    def environment_radiance(self) -> NDArray | None: ...

    def with_all_parts(self, radiance: NDArray) -> NDArray: ...

    def exposure(self) -> float: ...

    def sky_exposure(self) -> float: ...

    def shown_bytes(self) -> NDArray: ...

    def remembered(self, name: str, key: Any, compute: Callable[[], Any], *made_of: Any) -> Any: ...
