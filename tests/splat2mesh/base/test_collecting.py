"""The collector of cycles rests while a kernel compiles and while a command imports, and only then."""

import gc

import numba
import pytest
from numba.core import event

from splat2mesh.base.collecting import compile_without_collector, import_without_collector


class Watch(event.Listener):
    """Whether the collector was on when compilations began and ended; called after earlier listeners."""

    def __init__(self):
        self.begun, self.ended = [], []

    def on_start(self, _event):
        self.begun.append(gc.isenabled())

    def on_end(self, _event):
        self.ended.append(gc.isenabled())


@pytest.fixture
def watch():
    compile_without_collector()
    compile_without_collector()  # once is enough: a second pause would not change a thing
    listener = Watch()
    event.register("numba:compile", listener)
    yield listener
    event.unregister("numba:compile", listener)
    gc.enable()


def test_it_rests_through_nested_compilations_and_then_works_again(watch):
    inner = numba.njit(lambda x: x + 1)
    outer = numba.njit(lambda x: 2 * inner(x))
    assert outer(1) == 4
    assert watch.begun == [False, False]
    assert watch.ended == [False, True]  # the inner one first; the outer one ends with the collector on
    assert gc.isenabled()


def test_it_works_again_after_a_kernel_that_does_not_compile(watch):
    with pytest.raises(numba.TypingError):
        numba.njit(lambda x: x.missing)(1)
    assert gc.isenabled()


def test_who_turned_it_off_finds_it_off(watch):
    gc.disable()
    numba.njit(lambda x: x + 3)(1)
    assert not gc.isenabled()


def test_it_rests_while_a_command_imports_and_then_works_again_also_after_an_error():
    with pytest.raises(ImportError), import_without_collector():
        assert not gc.isenabled()
        raise ImportError("no such module")
    assert gc.isenabled()
    gc.disable()
    with import_without_collector():
        pass
    assert not gc.isenabled()
    gc.enable()
    gc.unfreeze()
