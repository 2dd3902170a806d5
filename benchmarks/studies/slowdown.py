"""Check that asv finds a slower release, with a slowdown of known size.

    python -m benchmarks.studies.slowdown [--factor 1.2] [--keep FOLDER]

creates a scratch history in which every release is the installed MuJoCo; the newest one also
installs a wheel that makes `mujoco.mj_step` take FACTOR times as long. asv measures it with this
checkout's benchmarks and settings.

Two arms are examined: unpaired times, which noise of the machine can distort, and the paired ratio
to a reference release. An arm finds the slowdown if `asv continuous` calls the newest release
slower for every model, calls no unchanged release slower, and the regressions page of `asv publish`
shows every model. The first line says which arms do. The exit code is 0 if at least one does, and 1
otherwise.

It takes about twenty minutes; leave the machine alone meanwhile.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from benchmarks.studies import tally_command

ROOT = Path(__file__).resolve().parents[2]
# The benchmark of each arm.
ARMS = {
    "the paired ratio": "reference.Reference.track_ratio_to_reference",
    "unpaired times": "step.Step.time_1000_steps",
}
# Unchanged releases before the slowed one: asv's step detection needs a level to compare with.
UNCHANGED = 6
WHEEL = "slowed_step-1.0-py3-none-any.whl"
MACHINE = {"arch": "", "cpu": "", "machine": "scratch", "num_cpu": "", "os": "", "ram": ""}

# Wraps mj_step as soon as mujoco has been imported, in every process of the environment.
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
    """Write a wheel that makes `mj_step` take `factor` times as long."""
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
    """Create the scratch history, a Git repository: tags v1 to v6 unchanged, v7 slowed."""
    folder.mkdir()
    _git(folder, "init", "--quiet", "--initial-branch=releases")
    for number in range(1, UNCHANGED + 2):
        requirements = f"mujoco=={version}\n"
        if number > UNCHANGED:
            write_wheel(folder, factor)
            # asv runs pip in the folder above the checkout, which is called `project`
            requirements += f"./project/{WHEEL}\n"
        (folder / "requirements.txt").write_text(f"# release {number}\n{requirements}")
        _git(folder, "add", "--all")
        date = f"2024-01-{number:02} 00:00:00 +0000"
        _git(folder, "commit", "--quiet", "-m", f"v{number}", date=date)
        _git(folder, "tag", f"v{number}")


def write_asv_config(folder: Path) -> None:
    """Write asv's configuration: this checkout's, for the scratch history."""
    from asv.util import load_json

    config = load_json(str(ROOT / "asv.conf.json"), js_comments=True)
    config |= {
        "project": "scratch",
        "repo": str(folder / "history"),
        "benchmark_dir": str(ROOT / "benchmarks"),
        "env_dir": str(folder / "env"),
        "results_dir": str(folder / "results"),
        "html_dir": str(folder / "html"),
        "uninstall_command": [f"{config['uninstall_command'][0]} slowed-step"],
    }
    (folder / "asv.conf.json").write_text(json.dumps(config))
    machine = {"version": 1, MACHINE["machine"]: MACHINE}
    (folder / ".asv-machine.json").write_text(json.dumps(machine))


def run_asv(folder: Path, *arguments: str) -> "subprocess.CompletedProcess[str]":
    """Run asv in the scratch folder, which is its home folder, too."""
    return subprocess.run(
        [sys.executable, "-m", "asv", *arguments],
        cwd=folder,
        env={**os.environ, "HOME": str(folder)},
        capture_output=True,
        text=True,
        check=False,
    )


def measure(folder: Path) -> None:
    """Measure every release of the scratch history, and write the regressions page."""
    selected = ("--machine", MACHINE["machine"], "--bench", "|".join(ARMS.values()))
    for arguments in (
        ("run", "ALL", "--interleave-rounds", "--record-samples", *selected),
        ("publish",),
    ):
        completed = run_asv(folder, *arguments)
        if completed.returncode:
            output = f"{completed.stdout[-3000:]}{completed.stderr[-2000:]}"
            raise SystemExit(f"asv {arguments[0]} failed:\n{output}")


def slower_models(folder: Path, benchmark: str, old: str, new: str) -> set[str]:
    """Return the models for which `asv continuous` calls the release `new` slower than `old`."""
    selected = ("--machine", MACHINE["machine"], "--bench", benchmark)
    completed = run_asv(folder, "continuous", old, new, "--factor", "1.1", *selected)
    if completed.returncode != 1:  # 1 says that something got slower
        return set()
    row = rf"^\|? *\+ .*{re.escape(benchmark)}\('(\w+)'\)"
    return set(re.findall(row, completed.stdout, re.MULTILINE))


def models_on_page(folder: Path, benchmark: str) -> set[str]:
    """Return the models that the regressions page shows for a benchmark."""
    rows = json.loads((folder / "html" / "regressions.json").read_text())["regressions"]
    title = rf"{re.escape(benchmark)}\('?(\w+)'?\)"
    return {match[1] for name, *_ in rows if (match := re.fullmatch(title, name))}


def _git(folder: Path, *arguments: str, date: str = "2024-01-01 00:00:00 +0000") -> None:
    identity = {"NAME": "scratch", "EMAIL": "scratch@example.invalid", "DATE": date}
    variables = {
        f"GIT_{role}_{name}": value
        for role in ("AUTHOR", "COMMITTER")
        for name, value in identity.items()
    }
    subprocess.run(["git", *arguments], cwd=folder, env={**os.environ, **variables}, check=True)


@dataclass(frozen=True)
class Detection:
    """What one arm detected.

    Attributes:
      missed: models that `asv continuous` did not call slower.
      missed_on_page: models that the regressions page does not show.
      false_alarms: models for which an unchanged release was called slower.
    """

    arm: str
    missed: set[str]
    missed_on_page: set[str]
    false_alarms: set[str]

    @property
    def passes(self) -> bool:
        """Whether it found every model, and nothing else."""
        return not (self.missed or self.missed_on_page or self.false_alarms)

    def __str__(self) -> str:
        """Return it as lines for people."""
        return (
            f"{self.arm} ({ARMS[self.arm]})\n"
            f"  asv continuous missed {_listed(self.missed)}\n"
            f"  asv continuous called {_listed(self.false_alarms)} slower in an unchanged release\n"
            f"  the regressions page missed {_listed(self.missed_on_page)}"
        )


def conclusion(factor: float, nmodel: int, detections: Sequence[Detection]) -> str:
    """Return which arms found the slowdown, in one line."""
    slowdown = f"mj_step, slowed {factor:g} times on {nmodel} models,"
    passed = [each.arm for each in detections if each.passes]
    others = [each.arm for each in detections if not each.passes]
    if not passed:
        return f"{slowdown} was found by neither {' nor '.join(others)}."
    not_by = f", not by {' and '.join(others)}" if others else ""
    return f"{slowdown} was found by {' and '.join(passed)}{not_by}."


def detect(folder: Path, arm: str, models: set[str]) -> Detection:
    """Return what an arm detected in the measured history."""
    before, last, newest = (f"v{UNCHANGED + n}" for n in (-1, 0, 1))
    benchmark = ARMS[arm]
    return Detection(
        arm,
        missed=models - slower_models(folder, benchmark, last, newest),
        missed_on_page=models - models_on_page(folder, benchmark),
        false_alarms=slower_models(folder, benchmark, before, last),
    )


def _listed(models: set[str]) -> str:
    return ", ".join(sorted(models)) or "none"


def main() -> int:
    """Run the check; return the exit code."""
    parser = tally_command.parser(__doc__)
    parser.add_argument("--factor", type=float, default=1.2, help="of the slowed mj_step")
    parser.add_argument("--keep", type=Path, help="an empty or new folder to work in and keep")
    options = parser.parse_args()
    from benchmarks import stored

    models = set(stored.light())
    with tempfile.TemporaryDirectory() as scratch:
        folder = (options.keep or Path(scratch)).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        write_history(folder / "history", metadata.version("mujoco"), options.factor)
        write_asv_config(folder)
        measure(folder)
        detections = [detect(folder, arm, models) for arm in ARMS]
    print(conclusion(options.factor, len(models), detections))
    print("\n".join(map(str, detections)))
    return int(not any(detection.passes for detection in detections))


if __name__ == "__main__":
    sys.exit(main())
