"""Types of kernels' arguments survive as text, through JSON."""

import json

import numpy as np
import pytest
from numba import typeof, types

from splat2mesh.base.ahead_worker import dispatcher_of
from splat2mesh.base.kernel_types import text_of, type_of
from splat2mesh.render.footprints import FOOTPRINT, Camera


def frozen(array):
    array.flags.writeable = False
    return array


@pytest.mark.parametrize(
    "value",
    [
        1,
        1.5,
        True,
        np.float32(1),
        np.uint8(1),
        np.zeros((2, 3), np.float32),
        np.zeros((4, 6))[::2, ::2],
        np.zeros((2, 3)).T,
        np.zeros(2, bool),
        frozen(np.zeros(2, np.int32)),
        np.zeros(2, FOOTPRINT),
        (1, 2.0, np.zeros(1)),
        (1, 2),
        Camera(np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3), 1.0, 1.0, 1.0, 1.0, 1, 1, 1.0),
    ],
    ids=repr,
)
def test_a_type_is_the_same_after_text(value):
    kind = typeof(value)
    assert type_of(json.loads(json.dumps(text_of(kind)))) == kind


def test_what_no_text_stands_for_is_refused_both_ways():
    with pytest.raises(ValueError, match="no type"):
        text_of(types.Dispatcher(dispatcher_of("splat2mesh.texture.atlas", "_areas")))
    for text in ("no_such_type", "Array", ["spiral", "float32"]):
        with pytest.raises(ValueError, match="no type"):
            type_of(text)
    assert type_of("none") == types.none
