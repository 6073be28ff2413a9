"""LightingOptions: what they refuse, what they keep, and that they are a value."""

import dataclasses
import math
import pickle
import subprocess
import sys

import pytest

from relight import LightingOptions
from relight.options import DEFAULT_TOLERANCE
from relight.transfer.settings import EFFECTS
from splat2mesh.base.errors import InputError

HEAVY = ("numpy", "scipy", "numba", "open3d")


@pytest.mark.parametrize(
    ("wishes", "message"),
    [
        ({"method": "magic"}, "`method` magic: expected one of auto raytraced"),
        ({"bands": 11}, "`bands` must be a whole number from 1 to 10, found 11"),
        ({"bands": 2.5}, "found 2.5"),
        ({"rays": 0}, "`rays` per vertex must be a whole number from 1 to 65536, found 0"),
        ({"seed": -1}, "`seed` must be a whole number from 0"),
        ({"seed": 2**64}, "`seed` must be"),
        ({"effects": "sun"}, "`effects` sun: sun, bounces and volume need shadows too"),
        ({"effects": "shadows", "method": "analytic"}, "`effects` shadows: the method analytic has none"),
        ({"tolerance": 0.0}, "`tolerance` must be a number above 0, found 0.0"),
        ({"tolerance": math.nan}, "`tolerance` must be"),
        ({"budget_s": math.inf}, "`budget_s` must be a number above 0, found inf"),
        ({"tolerance": 0.1, "budget_s": 1.0}, "`tolerance` and `budget_s`: expected one of them"),
    ],
)
def test_options_that_make_no_sense_are_refused_by_their_own_names(wishes, message):
    with pytest.raises(InputError) as caught:
        LightingOptions(**wishes)
    assert message in str(caught.value) and "--" not in str(caught.value)


def test_effects_are_kept_as_auto_or_a_set():
    assert LightingOptions().effects == "auto" and LightingOptions().fixed_effects is None
    assert LightingOptions().chosen_effects == frozenset(EFFECTS)
    assert LightingOptions("analytic").chosen_effects == frozenset()
    assert LightingOptions(effects="none").fixed_effects == frozenset()
    for same in ("shadows,sun", "sun shadows", ["sun", "shadows"], frozenset(("shadows", "sun"))):
        assert LightingOptions(effects=same) == LightingOptions(effects="shadows,sun")


def test_options_are_a_value():
    options = LightingOptions("raytraced", bands=4, rays=16, effects="shadows", tolerance=0.05, seed=3)
    assert pickle.loads(pickle.dumps(options)) == options and hash(options) == hash(dataclasses.replace(options))
    with pytest.raises(dataclasses.FrozenInstanceError):
        options.rays = 32


def test_changes_of_options():
    options = LightingOptions("raytraced", tolerance=0.05)
    assert LightingOptions.of(options) is options
    assert LightingOptions.of(options, rays=8) == LightingOptions("raytraced", rays=8, tolerance=0.05)
    assert LightingOptions.of("analytic", bands=3) == LightingOptions("analytic", bands=3)
    with pytest.raises(TypeError, match="budget"):
        LightingOptions.of(budget=3)


def test_what_is_not_planned_becomes_planned_within_the_default():
    assert not LightingOptions().is_planned and LightingOptions().planned().tolerance == DEFAULT_TOLERANCE
    for planned in (LightingOptions(tolerance=0.1), LightingOptions(budget_s=2.0)):
        assert planned.planned() is planned


def test_without_a_plan_everything_that_is_not_ruled_out_is_done():
    assert LightingOptions(effects="none").unplanned.method == "analytic"
    assert LightingOptions(rays=7).unplanned.rays == 7
    assert LightingOptions().unplanned.effects == frozenset(EFFECTS)
    assert LightingOptions("neural-gash", bands=8).unplanned.bands == 3


def test_importing_them_loads_nothing_heavy():
    code = f"import sys; import relight.options as o; o.LightingOptions(); print({HEAVY!r} & sys.modules.keys())"
    code = code.replace(repr(HEAVY), f"set({HEAVY!r})")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.strip() == "set()"
