"""The wheel and the source distribution hold what mjbench needs where it is installed."""

import os
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest
from commands import ROOT


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build both, from a copy of the files that git tracks; return their folder."""
    pytest.importorskip("build")
    pytest.importorskip("hatchling")
    folder = tmp_path_factory.mktemp("package")
    source, output = folder / "source", folder / "dist"
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        check=True,
    ).stdout.decode()
    for name in filter(None, listed.split("\0")):
        if (ROOT / name).is_file() and not name.startswith(("results/", "tests/")):
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            (source / name).write_bytes((ROOT / name).read_bytes())
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(output)]
    done = subprocess.run([*command, str(source)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return output


def test_the_wheel_has_models_and_templates(packages: Path) -> None:
    (wheel,) = packages.glob("*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    shipped = {f"mjbench/_models/{path.name}" for path in (ROOT / "models").glob("*.xml")}
    assert shipped <= set(names)
    assert "mjbench/results/templates/report.html.j2" in names
    assert not [name for name in names if name.startswith(("tests", "benchmarks", "results"))]


def test_the_source_distribution_can_be_built_again(packages: Path) -> None:
    (archive,) = packages.glob("*.tar.gz")
    with tarfile.open(archive) as content:
        names = {name.partition("/")[2] for name in content.getnames()}
    assert {"pyproject.toml", "README.md", "LICENSE", "models/cartpole.xml"} <= names
    assert not [name for name in names if name.startswith("results")]


def test_the_installed_wheel_runs(packages: Path, tmp_path: Path) -> None:
    (wheel,) = packages.glob("*.whl")
    site = tmp_path / "site"
    with zipfile.ZipFile(wheel) as content:
        content.extractall(site)
    env = {**os.environ, "PYTHONPATH": str(site)}
    program = "import mjbench; print(mjbench.__file__)"
    for arguments in (["-c", program], ["-m", "mjbench", "models"], ["-m", "mjbench", "paths"]):
        done = subprocess.run(
            [sys.executable, *arguments],
            cwd=tmp_path,
            env=env,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        assert str(site) in done.stdout or "mjbench" in arguments[1]
    assert "python_loop" in done.stdout
