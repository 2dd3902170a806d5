"""Python imports this at start, before the user's program, where its folder is on PYTHONPATH.

It starts the clocks, and then imports the `sitecustomize` that Python would have found
otherwise. Whatever goes wrong here must not reach the program.
"""

import importlib
import importlib.util
import os
import signal
import sys


def _start() -> None:
    here = os.path.dirname(os.path.abspath(__file__))
    sys.path[:] = [entry for entry in sys.path if os.path.abspath(entry or ".") != here]
    folder = os.environ.get("MJBENCH_STEP_CLOCK")
    if folder:
        # by another name: the program's environment may hold another mjbench
        spec = importlib.util.spec_from_file_location(
            "mjbench_hook", os.path.join(here, "__init__.py"), submodule_search_locations=[here]
        )
        assert spec is not None and spec.loader is not None, "it is a package"
        sys.modules["mjbench_hook"] = importlib.util.module_from_spec(spec)
        start = importlib.import_module("mjbench_hook.start").start
        start(folder)


def _import_next() -> None:
    own = sys.modules.pop("sitecustomize", None)
    try:
        importlib.import_module("sitecustomize")
    except ModuleNotFoundError as error:
        if error.name != "sitecustomize":
            raise
        if own is not None:
            sys.modules["sitecustomize"] = own


if __name__ == "sitecustomize":
    handler = signal.getsignal(signal.SIGINT)
    try:
        if handler is signal.default_int_handler:  # Ctrl-C ends the process without a traceback
            signal.signal(signal.SIGINT, signal.SIG_DFL)
        _start()
    except Exception as error:
        print(f"mjbench: steps are not timed: {error}", file=sys.stderr)
    if signal.getsignal(signal.SIGINT) is signal.SIG_DFL:
        signal.signal(signal.SIGINT, handler)
    _import_next()
