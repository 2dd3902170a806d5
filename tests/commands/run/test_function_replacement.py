"""What goes wrong in the clocks does not reach the program; what its signal handlers raise does."""

import functools
import importlib
import signal
import sys

import pytest

from mjbench.commands.run.hook import function_replacement


def handle(number, frame):
    raise TimeoutError("of the program")


def handle_with(text, number, frame):
    raise TimeoutError(text)


class Handler:
    def handle(self, number, frame):
        raise TimeoutError("of the program")

    def __call__(self, number, frame):
        raise TimeoutError("of the program")


@pytest.fixture
def set_handler():
    """Return what sets the handler of Ctrl-C."""
    earlier = signal.getsignal(signal.SIGINT)
    yield functools.partial(signal.signal, signal.SIGINT)
    signal.signal(signal.SIGINT, earlier)


HANDLERS = [handle, Handler().handle, Handler(), functools.partial(handle_with, "of the program")]


@pytest.mark.parametrize("handler", HANDLERS)
def test_what_a_signal_handler_raises_passes(set_handler, handler):
    set_handler(handler)
    with (
        pytest.raises(TimeoutError, match="of the program"),
        function_replacement.suppress(Exception),
    ):
        signal.raise_signal(signal.SIGINT)


def test_other_errors_are_suppressed_as_asked_for(set_handler):
    set_handler(handle)
    with function_replacement.suppress(OSError):
        raise TimeoutError("of the clocks")
    with pytest.raises(ValueError, match="another kind"), function_replacement.suppress(OSError):
        raise ValueError("another kind")


@pytest.fixture
def finder(monkeypatch, tmp_path):
    """Return what lets an action follow the import of a module."""
    (tmp_path / "imported.py").write_text("value = 1")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "imported", raising=False)

    def find(action):
        found = function_replacement.AfterImport({"imported": action})
        monkeypatch.setattr(sys, "meta_path", [found, *sys.meta_path])

    return find


def test_a_module_is_imported_though_the_clocks_fail(finder, capsys):
    def fail(module):
        raise TimeoutError("of the clocks")

    finder(fail)
    assert importlib.import_module("imported").value == 1
    assert capsys.readouterr().err == "mjbench: calls of imported are not timed: of the clocks\n"


def test_a_module_in_the_place_of_a_package_is_named(finder, capsys):
    finder(lambda module: module.mj_step)
    file = importlib.import_module("imported").__file__
    line = f"mjbench: calls of imported are not timed: {file} has no mj_step\n"
    assert capsys.readouterr().err == line


def test_a_signal_handler_that_raises_ends_an_import(finder, set_handler):
    set_handler(handle)
    finder(lambda module: signal.raise_signal(signal.SIGINT))
    with pytest.raises(TimeoutError, match="of the program"):
        importlib.import_module("imported")
