"""asv imports every benchmark module in environments of its own: NumPy and MuJoCo are enough."""

import os
import subprocess
import sys
import tomllib

from commands import ROOT

PROGRAM = """
import importlib, pkgutil, sys
for name in sys.argv[1:]:
    sys.modules[name] = None  # importing it raises ImportError
import benchmarks
for module in pkgutil.walk_packages(benchmarks.__path__, "benchmarks."):
    importlib.import_module(module.name)
    print(module.name)
"""


def test_the_modules_import_without_optional_packages() -> None:
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    (forbidden,) = [
        contract["forbidden_modules"]
        for contract in contracts["contracts"]
        if contract.get("source_modules") == ["benchmarks"]
    ]
    packages = {*forbidden, "mujoco_warp", "ray", "warp"}
    assert {"asv", "click", "msgspec", "pytest", "psutil", "rich", "scipy"} <= packages
    completed = subprocess.run(
        [sys.executable, "-c", PROGRAM, *sorted(packages)],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert completed.returncode == 0, completed.stderr
    modules = {f"benchmarks.{file.stem}" for file in ROOT.glob("benchmarks/*.py")}
    assert set(completed.stdout.split()) == modules - {"benchmarks.__init__"}
