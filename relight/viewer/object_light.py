"""The light of a session on its objects."""

from collections.abc import Hashable
from typing import TYPE_CHECKING

import numpy as np

from .object_bench import ObjectBench
from .object_source import ObjectsUnder

if TYPE_CHECKING:
    from .session_view import SessionView


def light_key(session: "SessionView") -> Hashable:
    """The dependencies of the light on objects, besides their poses."""
    state, board = session.state, None if session.board is None else session.board.state
    return state.environment, state.angle_deg, state.lamps, session.effects, board


def light_now(session: "SessionView", objects: ObjectBench) -> ObjectsUnder:
    """The present light on objects. The worker must have answered."""
    mixture, alone, plain = session.mixture, session.environment_radiance(), session.plain_radiance()
    assert alone is not None and plain is not None  # or the worker has not answered
    look, exposure = objects.source.received, session.exposure()
    received = np.asarray((look if mixture is None else mixture.receives(look))(alone, exposure), np.float32)
    environment, angle = session.environments[session.state.environment], session.state.angle_deg
    if mixture is None:
        return ObjectsUnder(environment, angle, 1.0, 0.0, (), exposure, plain, received)
    board = None if session.board is None else session.board.state
    lamps = () if board is None else tuple(lamp.asked for lamp in board.lamps)
    captured = 0.0 if board is None else board.captured
    return ObjectsUnder(environment, angle, mixture.env_scale, captured, lamps, mixture.level, plain, received)
