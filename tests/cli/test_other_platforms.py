"""Every command as if on macOS and on Windows: what Linux alone has is hidden."""

import json
import shutil
from pathlib import Path

import other_platforms
import pytest
from commands import ROOT
from example_models import CONTACT_XML
from other_platforms import Ended

from mjbench.cli import cli
from mjbench.host.platforms import RUN_ON_WINDOWS

RUN = "run.jsonl"
WORDS = {
    "lint": ["lint", "script.py"],
    "show": ["show", RUN],
    "diff": ["show", "--list", "--results", "."],
}
QUICK = ["--nbatch", "4", "--nstep", "20"]
MACOS = {
    **WORDS,
    "compare": ["compare", "contact.xml", "--paths", "rollout,processes", *QUICK, "--threads", "2",
                "--budget", "0.1", "--results", "runs"],
    "versions": ["versions", "installed", "installed", "cartpole", *QUICK,
                 "--budget", "0.1s", "--results", "runs"],
    "profile": ["profile", "cartpole", "--budget", "0.1s"],
    "overhead": ["profile", "--habits", "contact.xml", "--budget", "0.1s"],
    "models": ["models", "cartpole"],
    "releases": ["releases", "installs"],
    "instructions": ["profile", "--instructions", "cartpole"],
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a model, a script and a run file."""
    folder = tmp_path_factory.mktemp("other")
    (folder / "contact.xml").write_text(CONTACT_XML)
    (folder / "script.py").write_text("x = 1\n")
    shutil.copy(ROOT / "results/runs/reference-mjx-cpu.jsonl", folder / RUN)
    return folder


@pytest.fixture(scope="module")
def windows(folder: Path) -> dict[str, Ended]:
    """Return how every command ends as if on Windows, and how its help does."""
    words = {name: WORDS.get(name, name.split()) for name in cli.commands}
    helps = {f"{name} --help": [*name.split(), "--help"] for name in cli.commands}
    others = {"--help": ["--help"], "releases install": ["releases", "install", "3.5.0"]}
    return other_platforms.commands("win32", {**words, **helps, **others}, folder)


@pytest.fixture(scope="module")
def macos(folder: Path) -> dict[str, Ended]:
    """Return how commands end as if on macOS."""
    # which MuJoCo needs on macOS, and Debian's Python leaves out
    pytest.importorskip("ctypes.macholib.dyld")
    return other_platforms.commands("darwin", MACOS, folder)


@pytest.mark.parametrize("name", [*cli.commands, "releases install"])
def test_on_windows_a_command_works_or_is_refused_in_one_line(
    windows: dict[str, Ended], name: str
) -> None:
    ended = windows[name]
    command = name.replace(" install", "")
    if command in RUN_ON_WINDOWS:
        assert ended.code == 0, ended.stderr
        assert ended.stderr == ""
    else:
        assert ended.code == 3
        assert ended.stdout == ""
        assert ended.stderr == (
            f"mjbench: `mjbench {command}` does not run on Windows; use WSL2."
            " Commands that run on Windows: lint, show, paths\n"
        )


@pytest.mark.parametrize("name", ["--help", *(f"{name} --help" for name in cli.commands)])
def test_on_windows_help_is_help(windows: dict[str, Ended], name: str) -> None:
    assert windows[name].code == 0
    assert windows[name].stdout.startswith("Usage: ")


WORK_ON_MACOS = sorted(set(MACOS) - {"instructions"})


@pytest.mark.parametrize("name", WORK_ON_MACOS)
def test_on_macos_a_command_works(macos: dict[str, Ended], name: str) -> None:
    assert macos[name].code == 0, macos[name].stderr
    assert macos[name].stdout or name == "lint"


def test_on_macos_what_needs_linux_says_so(macos: dict[str, Ended]) -> None:
    assert macos["instructions"].code == 3
    assert "needs Linux" in macos["instructions"].stderr.splitlines()[-1]


def test_on_macos_nothing_can_be_moved(macos: dict[str, Ended]) -> None:
    assert "compared as shipped: the code of MuJoCo" in macos["versions"].stdout


def test_on_macos_paths_agree_and_are_timed(macos: dict[str, Ended], folder: Path) -> None:
    (file,) = (folder / "runs").glob("*-compare.jsonl")
    _, *records = map(json.loads, file.read_text().splitlines())
    assert {record["status"] for record in records} == {"ok"}
    assert {"python_loop", "rollout", "processes"} == {r["path"] for r in records if "path" in r}


def test_on_macos_a_paired_comparison_says_that_it_is_not_pinned(
    macos: dict[str, Ended], folder: Path
) -> None:
    assert "cannot keep a process on one core" in macos["versions"].stderr
    (file,) = (folder / "runs").glob("*-versions.jsonl")
    _, verdict = map(json.loads, file.read_text().splitlines())
    assert {launch["core"] for launch in verdict["samples"]} == {None}


def test_on_macos_frames_are_rendered_by_cgl(macos: dict[str, Ended]) -> None:
    assert "cgl" in macos["profile"].stdout
    assert "egl" not in macos["profile"].stdout
