"""`mjbench releases` as a user types it, without network."""

import json
import os
import time
from importlib import metadata
from pathlib import Path

import pytest
from commands import mjbench

from mjbench.releases import package_index, pip

# An index that refuses the connection at once, wherever the tests run.
OFFLINE = {"PIP_CONFIG_FILE": os.devnull, "PIP_INDEX_URL": "http://127.0.0.1:9/simple"}


def test_without_network_the_list_shows_what_is_known_here_and_says_so(tmp_path: Path) -> None:
    out = tmp_path / "out.json"
    marker = tmp_path / "3.5.0-cpython" / "installed-by-mjbench"
    marker.parent.mkdir()
    marker.write_text("")
    here = OFFLINE | {"MJBENCH_CACHE": str(tmp_path)}
    done = mjbench("releases", "list", "--json", str(out), env=here)
    assert done.returncode == 0
    assert len(done.stderr.splitlines()) == 1
    assert "package index" in done.stderr
    document = json.loads(out.read_text())
    assert document["schema"] == 1
    rows = {row["version"]: row for row in document["results"]}
    assert rows["3.5.0"]["in_cache"]
    assert rows["3.5.0"]["in_index"] is None
    assert [v for v, row in rows.items() if row["installed"]] == [metadata.version("mujoco")]


def test_installs_are_listed_and_removed_by_version(tmp_path: Path) -> None:
    for name in ("3.5.0-cpython", "3.5.0+abc-cpython", "3.5.0.post1-cpython"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "installed-by-mjbench").write_text("")
    here = {"MJBENCH_CACHE": str(tmp_path)}
    done = mjbench("releases", "remove", "3.5.0", env=here)
    assert done.returncode == 0
    assert done.stdout.splitlines() == ["removed 3.5.0+abc-cpython", "removed 3.5.0-cpython"]
    done = mjbench("releases", "installs", env=here)
    assert done.stdout.splitlines() == [f"In {tmp_path}:", "3.5.0.post1-cpython  0 MiB, used today"]


def test_installs_that_were_not_used_for_long_are_pruned(tmp_path: Path) -> None:
    for name, days in (("3.5.0-cpython", 40), ("3.6.0-cpython", 3)):
        marker = tmp_path / name / "installed-by-mjbench"
        marker.parent.mkdir()
        marker.write_text("")
        (marker.parent / "library").write_bytes(bytes(3 * 2**20))
        used = time.time() - days * 86_400
        os.utime(marker, (used, used))
    here = {"MJBENCH_CACHE": str(tmp_path)}
    done = mjbench("releases", "installs", "--json", "-", env=here)
    rows = json.loads(done.stdout)["installs"]
    assert [(row["name"], row["size_bytes"]) for row in rows] == [
        ("3.5.0-cpython", 3 * 2**20),
        ("3.6.0-cpython", 3 * 2**20),
    ]
    assert "3.5.0-cpython  3 MiB, used 40 days ago" in done.stderr
    assert "2 installs, 6 MiB" in done.stderr
    done = mjbench("releases", "prune", env=here)
    assert done.stdout.splitlines() == ["removed 3.5.0-cpython", "freed 3 MiB"]
    done = mjbench("releases", "prune", "--days", "0", env=here)
    assert done.stdout.splitlines() == ["removed 3.6.0-cpython", "freed 3 MiB"]
    assert mjbench("releases", "prune", env=here).stdout.splitlines() == ["freed 0 MiB"]


@pytest.mark.parametrize(
    "command",
    [
        "versions installed 9.9.9 cartpole",
        "versions mujoco==3.4.0,jax==0.7.0 mujoco==9.9.9,jax==0.7.0 cartpole --paths mjx",
        "versions --explain installed 9.9.9 cartpole",
        "ab cartpole,release=3.4.0 release=9.9.9",
        "bisect 3.4.0 9.9.9 cartpole",
        "profile --instructions --releases 9.9.9 cartpole",
        "releases install 3.4.0 9.9.9",
    ],
)
def test_a_version_that_does_not_exist_ends_a_command_before_anything_is_installed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    files = {version: [f"mujoco-{version}-py3-none-any.whl"] for version in ("3.4.0", "3.5.0")}
    monkeypatch.setattr(package_index, "files", lambda: files)
    monkeypatch.setattr(pip, "is_available", lambda version: False)
    monkeypatch.setattr(pip, "install", lambda *_: pytest.fail("a release is installed"))
    done = mjbench(*command.split(), env={"MJBENCH_CACHE": str(tmp_path)})
    assert done.returncode == 2
    assert done.stderr == (
        "mjbench: there is no MuJoCo 9.9.9 on the package index; the nearest are 3.4.0, 3.5.0\n"
    )
    assert done.stdout == ""
    assert not (tmp_path / "locks").exists()
