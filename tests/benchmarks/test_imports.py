"""asv imports every benchmark module in environments of its own, which hold few packages.

They hold MuJoCo, NumPy and what the install command of asv.conf.json names.
"""

import os
import re
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
        c["forbidden_modules"] for c in contracts["contracts"] if c["type"] == "forbidden"
    ]
    (installed,) = re.findall(r"requirements\.txt([\w ]*)\"", (ROOT / "asv.conf.json").read_text())
    packages = {*forbidden, "jax", "mujoco_warp", "ray", "warp"} - set(installed.split())
    assert {"asv", "click", "msgspec", "psutil", "rich", "scipy"} <= packages
    completed = subprocess.run(
        [sys.executable, "-c", PROGRAM, *sorted(packages)],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert completed.returncode == 0, completed.stderr
    files = {*ROOT.glob("benchmarks/*.py"), *ROOT.glob("benchmarks/studies/*.py")}
    modules = {".".join(file.relative_to(ROOT).with_suffix("").parts) for file in files}
    packages = {module for module in modules if module.endswith(".__init__")}
    assert set(completed.stdout.split()) - {"benchmarks.studies"} == modules - packages
