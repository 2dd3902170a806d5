"""Does asv find a slower release? A check of the whole chain, with a slowdown of known size.

    python -m benchmarks.slowdown [--factor 1.2] [--keep FOLDER]

makes a scratch history in which every release is the MuJoCo installed here, and the newest one
also installs a wheel that makes `mujoco.mj_step` take FACTOR times as long. asv measures it with
this checkout's benchmarks and settings; then `asv continuous` must name every model, and the
regressions page of `asv publish` must show each, by one of two benchmarks: unpaired times, which a
noisy machine bends, and the paired ratio to a reference release. Takes about eight minutes; leave
the machine alone meanwhile. Exit code 1 if a model was missed by both, or if an unchanged release
was called slower.
"""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import zipfile
from importlib import metadata
from pathlib import Path

from mjbench.releases.benchmark_names import BenchmarkName

ROOT = Path(__file__).resolve().parent.parent
# The unpaired times, and the paired ratio to a reference release, which has to find it.
BENCHMARKS = (BenchmarkName.STEP_TIME, BenchmarkName.RATIO_TO_REFERENCE)
# Unchanged releases before the slowed one: asv's step detection needs a level to compare with.
UNCHANGED = 6
WHEEL = "slowed_step-1.0-py3-none-any.whl"
MACHINE = {"arch": "", "cpu": "", "machine": "scratch", "num_cpu": "", "os": "", "ram": ""}

# Wraps mj_step as soon as mujoco was imported, in every process of the environment.
_HOOK = """\
import importlib.abc, importlib.machinery, sys, time

class Loader(importlib.abc.Loader):
    def __init__(self, inner):
        self.inner = inner
    def create_module(self, spec):
        return self.inner.create_module(spec)
    def exec_module(self, module):
        self.inner.exec_module(module)
        step, clock = module.mj_step, time.perf_counter
        def mj_step(*args, **named):
            start = clock()
            step(*args, **named)
            end = start + {factor} * (clock() - start)
            while clock() < end:
                pass
        module.mj_step = mj_step

class Finder(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name != "mujoco":
            return None
        spec = importlib.machinery.PathFinder.find_spec(name, path)
        if spec is not None:
            spec.loader = Loader(spec.loader)
        return spec

sys.meta_path.insert(0, Finder())
"""


def write_wheel(folder: Path, factor: float) -> None:
    """Write the wheel that slows `mj_step` down."""
    info = "slowed_step-1.0.dist-info"
    files = {
        "slowed_step.py": _HOOK.format(factor=factor),
        "slowed_step.pth": "import slowed_step\n",
        f"{info}/METADATA": "Metadata-Version: 2.1\nName: slowed-step\nVersion: 1.0\n",
        f"{info}/WHEEL": "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
    }
    files[f"{info}/RECORD"] = "".join(f"{name},,\n" for name in [*files, f"{info}/RECORD"])
    with zipfile.ZipFile(folder / WHEEL, "w") as wheel:
        for name, content in files.items():
            wheel.writestr(name, content)


def write_history(folder: Path, version: str, factor: float) -> None:
    """Make the scratch history: tags v1 to v6 unchanged, v7 slowed."""
    folder.mkdir()
    _git(folder, "init", "--quiet", "--initial-branch=releases")
    for number in range(1, UNCHANGED + 2):
        needs = f"mujoco=={version}\n"
        if number > UNCHANGED:
            write_wheel(folder, factor)
            needs += f"./project/{WHEEL}\n"  # pip stands one folder above the checkout
        (folder / "requirements.txt").write_text(f"# release {number}\n{needs}")
        _git(folder, "add", "--all")
        date = f"2024-01-{number:02} 00:00:00 +0000"
        _git(folder, "commit", "--quiet", "-m", f"v{number}", date=date)
        _git(folder, "tag", f"v{number}")


def write_settings(folder: Path) -> None:
    """Write asv's configuration: the checkout's, over the scratch history."""
    from asv.util import load_json

    settings = load_json(str(ROOT / "asv.conf.json"), js_comments=True)
    settings |= {
        "project": "scratch",
        "repo": str(folder / "history"),
        "benchmark_dir": str(ROOT / "benchmarks"),
        "env_dir": str(folder / "env"),
        "results_dir": str(folder / "results"),
        "html_dir": str(folder / "html"),
        "uninstall_command": [f"{settings['uninstall_command'][0]} slowed-step"],
    }
    (folder / "asv.conf.json").write_text(json.dumps(settings))
    machine = {"version": 1, MACHINE["machine"]: MACHINE}
    (folder / ".asv-machine.json").write_text(json.dumps(machine))


def asv(folder: Path, *words: str) -> "subprocess.CompletedProcess[str]":
    """Run asv in the scratch folder, which is its home too."""
    return subprocess.run(
        [sys.executable, "-m", "asv", *words],
        cwd=folder,
        env={**os.environ, "HOME": str(folder)},
        capture_output=True,
        text=True,
        check=False,
    )


def measure(folder: Path) -> None:
    """Measure every release of the scratch history."""
    where = ("--machine", MACHINE["machine"], "--bench", "|".join(BENCHMARKS))
    done = asv(folder, "run", "ALL", "--interleave-rounds", "--record-samples", *where)
    if done.returncode:
        raise SystemExit(f"asv run failed:\n{done.stdout[-3000:]}{done.stderr[-2000:]}")


def slower(folder: Path, benchmark: str, old: str, new: str) -> list[str]:
    """Return the models that `asv continuous` calls slower; none unless it exits with 1."""
    where = ("--machine", MACHINE["machine"], "--bench", benchmark)
    done = asv(folder, "continuous", old, new, "--factor", "1.1", *where)
    named = rf"^\|? *\+ .*{re.escape(benchmark)}\('(\w+)'\)"
    return re.findall(named, done.stdout, re.MULTILINE) if done.returncode == 1 else []


def on_the_page(folder: Path, benchmark: str) -> list[str]:
    """Return the models on the regressions page."""
    shown = json.loads((folder / "html" / "regressions.json").read_text())["regressions"]
    named = rf"{re.escape(benchmark)}\('?(\w+)'?\)"
    return [found[1] for name, *_ in shown if (found := re.fullmatch(named, name))]


def _git(folder: Path, *words: str, date: str = "2024-01-01 00:00:00 +0000") -> None:
    who = {"NAME": "scratch", "EMAIL": "scratch@example.invalid", "DATE": date}
    names = {f"GIT_{role}_{k}": v for role in ("AUTHOR", "COMMITTER") for k, v in who.items()}
    subprocess.run(["git", *words], cwd=folder, env={**os.environ, **names}, check=True)


def main() -> int:
    """Run the check; return the exit code."""
    assert __doc__ is not None
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--factor", type=float, default=1.2, help="of the slowed mj_step")
    parser.add_argument("--keep", type=Path, help="an empty or new folder to work in and leave")
    given = parser.parse_args()
    from benchmarks import stored

    models = stored.light()
    with tempfile.TemporaryDirectory() as scratch:
        folder = (given.keep or Path(scratch)).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        write_history(folder / "history", metadata.version("mujoco"), given.factor)
        write_settings(folder)
        measure(folder)
        before, last, newest = (f"v{UNCHANGED + n}" for n in (-1, 0, 1))
        done = asv(folder, "publish")
        if done.returncode:
            raise SystemExit(f"asv publish failed:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
        print(f"mj_step slowed {given.factor} times, {len(models)} models")
        sound = False
        for benchmark in BENCHMARKS:
            found = slower(folder, benchmark, last, newest)
            alarms = slower(folder, benchmark, before, last)
            shown = on_the_page(folder, benchmark)
            print(f"{benchmark}")
            print(f"  asv continuous: missed {_missed(models, found)}")
            print(f"  asv continuous, unchanged releases: {len(alarms)} false alarms")
            print(f"  regressions page: missed {_missed(models, shown)}")
            sound |= not (set(models) - set(found) or set(models) - set(shown) or alarms)
    return int(not sound)


def _missed(models: list[str], found: list[str]) -> str:
    return ", ".join(sorted(set(models) - set(found))) or "none"


if __name__ == "__main__":
    sys.exit(main())
