import base64
import hashlib
import shutil
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

import mujoco
import pytest

from mjbench.releases import install_check


def test_the_installed_release_has_no_problem() -> None:
    assert install_check.imported_problem() is None
    assert install_check.imported_problem(metadata.version("mujoco")) is None


def test_another_release_than_the_expected_one_is_refused() -> None:
    assert "expected MuJoCo 2.3.7" in (install_check.imported_problem("2.3.7") or "")


@pytest.mark.parametrize(
    ("attribute", "value", "message"),
    [
        ("__version__", "2.0.0", "the package is 2.0.0"),
        ("mj_versionString", lambda: "2.0.0", "the C library is 2.0.0"),
        ("__path__", [*mujoco.__path__, "/elsewhere/mujoco"], "is mixed from"),
    ],
)
def test_a_mixed_release_is_refused(
    monkeypatch: pytest.MonkeyPatch, attribute: str, value: Any, message: str
) -> None:
    monkeypatch.setattr(mujoco, attribute, value)
    assert message in (install_check.imported_problem() or "")


def test_a_distribution_left_by_another_release_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    class Remaining:
        metadata = {"Name": "mujoco-core"}  # noqa: RUF012
        version = "4.1.0"

    monkeypatch.setattr(install_check, "_distributions", lambda: [Remaining()])
    assert "distribution mujoco-core is 4.1.0" in (install_check.imported_problem() or "")


def test_a_module_from_elsewhere_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    stray = type(sys)("mujoco.stray")
    stray.__file__ = str(tmp_path / "stray.py")
    monkeypatch.setitem(sys.modules, "mujoco.stray", stray)
    assert "module mujoco.stray was loaded from" in (install_check.imported_problem() or "")


@pytest.mark.parametrize(
    "version", ["4.1.0", "4.1.0rc1", "4.1.0.dev3", "4.1.0.post1", "4.1.0+g1a2b3c"]
)
def test_the_engine_knows_only_the_numbers_of_a_version(
    monkeypatch: pytest.MonkeyPatch, version: str
) -> None:
    monkeypatch.setattr(mujoco, "__version__", "4.1.0")
    monkeypatch.setattr(mujoco, "mj_versionString", lambda: "4.1.0")
    assert install_check._wrong_versions(version, []) == []
    assert install_check._wrong_versions("4.1.1", []) == [
        "the package is 4.1.0",
        "the C library is 4.1.0",
    ]


@pytest.fixture
def install(tmp_path: Path) -> Path:
    """A folder with a release and another distribution, made by hand."""
    for name, files in {
        "mujoco-9.9.9": {
            "mujoco/libmujoco.so.9.9.9": b"machine code",
            "mujoco/part.py": b"part = 1",
        },
        "other-1.0": {"other/native.cpython-311.so": b"machine code", "other/part.py": b"part = 1"},
    }.items():
        record = f"{name}.dist-info/RECORD,,\n../../bin/other,sha256=moved,1\nother/a.pyc,,\n"
        for file, content in files.items():
            (tmp_path / file).parent.mkdir(exist_ok=True)
            (tmp_path / file).write_bytes(content)
            digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).decode()
            record += f"{file},sha256={digest.rstrip('=')},{len(content)}\n"
        (tmp_path / f"{name}.dist-info").mkdir()
        (tmp_path / f"{name}.dist-info" / "RECORD").write_text(record)
    assert install_check.damaged_file(tmp_path) is None
    return tmp_path


@pytest.mark.parametrize(
    "name", ["mujoco/libmujoco.so.9.9.9", "mujoco/part.py", "other/native.cpython-311.so"]
)
def test_a_flipped_bit_is_noticed(install: Path, name: str) -> None:
    content = bytearray((install / name).read_bytes())
    content[5] ^= 1
    (install / name).write_bytes(content)
    assert install_check.damaged_file(install) == f"{name} has been changed"


@pytest.mark.parametrize(
    ("name", "content", "problem"),
    [
        ("other/part.py", b"part = 12", "other/part.py has been changed"),
        ("other/part.py", None, "other/part.py is missing"),
        ("mujoco-9.9.9.dist-info", None, "MuJoCo is missing"),
        ("other-1.0.dist-info/RECORD", None, "other-1.0.dist-info/RECORD cannot be read"),
        ("other-1.0.dist-info/RECORD", b"\xff", "other-1.0.dist-info/RECORD cannot be read"),
        ("other-1.0.dist-info/RECORD", b"other/part.py\n", "a RECORD is broken: "),
        ("other-1.0.dist-info/RECORD", b"other/part.py,,many\n", "a RECORD is broken: "),
        ("other-1.0.dist-info/RECORD", b"other/part.py/x,,8\n", "other/part.py/x cannot be read: "),
        ("mujoco-9.9.9.dist-info/RECORD", b"mujoco/part.py,md0=x,8\n", None),
        ("other-1.0.dist-info/RECORD", b"other/part.pyc,sha256=x,8\n", None),
    ],
)
def test_an_install_is_as_its_wheels_were_or_the_first_other_file_is_named(
    install: Path, name: str, content: bytes | None, problem: str | None
) -> None:
    if content is not None:
        (install / name).write_bytes(content)
    elif (install / name).is_dir():
        shutil.rmtree(install / name)
    else:
        (install / name).unlink()
    actual = install_check.damaged_file(install)
    assert actual == problem if problem is None else (actual or "").startswith(problem)


def test_a_changed_file_of_the_environments_own_mujoco_is_named(
    install: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    info = install / "mujoco-9.9.9.dist-info"
    info.joinpath("METADATA").write_text("Metadata-Version: 2.1\nName: mujoco\nVersion: 9.9.9\n")
    monkeypatch.setattr(
        install_check,
        "_distributions",
        lambda: metadata.distributions(name="mujoco", path=[str(install)]),
    )
    assert install_check.changed_file() is None
    (install / "mujoco/part.py").write_bytes(b"part = 2")
    assert install_check.changed_file() == "mujoco/part.py has been changed"
    (info / "RECORD").unlink()  # as some package managers leave it
    assert install_check.changed_file() is None
