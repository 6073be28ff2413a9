"""A closed room in which something moves: its lamps as they were found, and their light on every pose."""

import numpy as np
from numpy.typing import NDArray

from ..albedo import samples
from ..transfer.bounces import Interreflection, with_bounces
from ..transfer.occluder import Occluder
from .evenness import Evenness
from .lamps import Lamp, light_of
from .room import AVERAGING_ROUNDS, Room


class RoomPoses:
    """A Room of V vertices as it was found in a first pose. occluder, interreflection: of that."""

    def __init__(self, room: Room, occluder: Occluder, interreflection: Interreflection) -> None:
        self._room, self._areas = room, samples.vertex_areas(occluder)
        rows = [np.flatnonzero(room.lamp_of == number) for number in range(len(room.lamp_light))]
        self._lamps = [
            Lamp(each, float(self._areas[each].sum()), np.zeros(3), np.zeros(3), np.ones(3)) for each in rows
        ]
        self._lights = self._under(occluder)
        square = np.maximum(np.einsum("lv,lv->l", self._lights, self._lights), 1e-30)
        self._radiance = np.einsum("lv,lvc->lc", self._lights, room.lamp_light) / square[:, None]
        self._sent = self._bounced(room.lamp_light, interreflection)

    def at(self, occluder: Occluder, interreflection: Interreflection) -> Room:
        """The Room in another pose: what its lamps send there, and all else as it was found."""
        room, more = self._room, self._under(occluder) - self._lights
        each = room.lamp_light + more[:, :, None] * self._radiance[:, None].astype(np.float32)
        sent = self._bounced(each, interreflection) - self._sent
        return room._replace(lamp_light=np.maximum(each, 0.0), by_lamps=np.maximum(room.by_lamps + sent, 0.0))

    def _under(self, occluder: Occluder) -> NDArray[np.float32]:
        """(L, V) light of each lamp at radiance 1, as `room_of` finds it."""
        even = Evenness(occluder)
        normals = even.average_directions(occluder.normals, AVERAGING_ROUNDS)
        found = np.zeros((len(self._lamps), len(occluder.origins)), np.float32)
        for light, lamp in zip(found, self._lamps, strict=True):
            if len(lamp.rows):
                light[:] = even.average(light_of(lamp, occluder, self._areas, normals), AVERAGING_ROUNDS)
        return found

    def _bounced(self, each: NDArray[np.float32], interreflection: Interreflection) -> NDArray[np.float32]:
        return with_bounces(each.sum(axis=0), self._room.albedo, interreflection)[0]
