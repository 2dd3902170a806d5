"""A worker process with one method that misbehaves."""

import os
from pathlib import Path

from commands import ROOT


def python_path(folder: Path, method: str, code: str) -> str:
    """Return the PYTHONPATH with which a method of `Worker` runs `code` instead.

    Args:
      folder: for a `sitecustomize` module.
      method: of mjbench.paired.worker.Worker.
      code: a statement; it may use os, time and signal.
    """
    (folder / "sitecustomize.py").write_text(
        "import os, time, signal\n"
        "import importlib.abc, importlib.machinery, sys\n"
        "def bad(self, *args, **kwargs):\n"
        f"    {code}\n"
        "class Loader(importlib.abc.Loader):\n"
        "    def __init__(self, inner): self.inner = inner\n"
        "    def create_module(self, spec): return self.inner.create_module(spec)\n"
        "    def exec_module(self, module):\n"
        "        self.inner.exec_module(module)\n"
        f"        assert hasattr(module.Worker, {method!r})\n"
        f"        module.Worker.{method} = bad\n"
        "class Finder(importlib.abc.MetaPathFinder):\n"
        "    def find_spec(self, name, path, target=None):\n"
        "        if name != 'mjbench.paired.worker': return None\n"
        "        spec = importlib.machinery.PathFinder.find_spec(name, path)\n"
        "        spec.loader = Loader(spec.loader)\n"
        "        return spec\n"
        "sys.meta_path.insert(0, Finder())\n"
    )
    return f"{folder}{os.pathsep}{ROOT}"
