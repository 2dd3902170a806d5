"""How pip is run, and what its failures mean. A script stands in for Python, so for pip too."""

import contextlib
import logging
import os
import select
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from commands import started
from packaging import tags

from mjbench.errors import InputError, MachineError
from mjbench.releases import package_index, pip

HERE = str(next(tags.sys_tags()))
NO_MATCH = (
    "ERROR: Could not find a version that satisfies the requirement mujoco==9.9.9"
    " (from versions: none)\\nERROR: No matching distribution found for mujoco==9.9.9\\n"
)
FullIndex = Callable[..., None]


@pytest.fixture
def index(monkeypatch: pytest.MonkeyPatch) -> FullIndex:
    """Return a function that replaces the index by one with wheels of these versions."""

    def replace(*versions: str, tag: str = HERE) -> None:
        files = {version: [f"mujoco-{version}-{tag}.whl"] for version in versions}
        monkeypatch.setattr(package_index, "files", lambda: files)

    return replace


@pytest.fixture
def failing_pip(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Return a function that has pip write a text to standard error and fail."""

    def replace(stderr: str) -> None:
        script(tmp_path / "python", f"printf '{stderr}' >&2\nexit 1\n")
        monkeypatch.setattr(sys, "executable", str(tmp_path / "python"))

    return replace


def script(file: Path, commands: str) -> None:
    file.write_text(f"#!/bin/sh\n{commands}")
    file.chmod(0o755)


@pytest.mark.parametrize(
    ("version", "nearest"),
    [
        ("9.9.9", "3.2.0, 3.3.0, 3.3.1, 4.0.0"),
        ("3.2.7", "3.1.0, 3.2.0, 3.3.0, 3.3.1"),
        ("2.9.9", "3.0.0, 3.1.0, 3.2.0, 3.3.0"),
        ("4.0.0rc1", "3.2.0, 3.3.0, 3.3.1, 4.0.0"),
    ],
)
def test_a_version_that_does_not_exist_is_refused_with_the_nearest_ones(
    failing_pip: Callable[[str], None], index: FullIndex, tmp_path: Path, version: str, nearest: str
) -> None:
    failing_pip(NO_MATCH)
    index("2.3.6", "4.0.0", "3.0.0", "3.1.0", "3.2.0", "3.3.1", "3.3.0", "3.3.0rc2")
    with pytest.raises(InputError) as raised:
        pip.install(version, (), tmp_path / "target")
    assert str(raised.value) == (
        f"there is no MuJoCo {version} on the package index; the nearest are {nearest}"
    )


def test_a_version_without_a_wheel_for_this_python_is_refused(
    failing_pip: Callable[[str], None], index: FullIndex, tmp_path: Path
) -> None:
    failing_pip(NO_MATCH)
    index("3.3.0", tag="cp27-cp27m-win32")
    with pytest.raises(InputError, match=r"^there is no MuJoCo 3\.3\.0 for this Python$"):
        pip.install("3.3.0", (), tmp_path / "target")


def test_pip_is_asked_whether_it_has_a_version(
    failing_pip: Callable[[str], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    failing_pip(NO_MATCH)
    assert not pip.is_available("9.9.9")
    script(tmp_path / "python", 'case "$*" in *--dry-run*mujoco==3.5.0) ;; *) exit 1 ;; esac\n')
    assert pip.is_available("3.5.0")


@pytest.mark.parametrize("wheels", [(), ("mujoco-9.9.9-py3-none-any.whl",)])
def test_an_index_that_cannot_be_reached_is_said(
    failing_pip: Callable[[str], None],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    wheels: tuple[str, ...],
) -> None:
    def unreachable() -> None:
        raise MachineError("cannot read the releases of mujoco from the package index: refused")

    failing_pip(NO_MATCH)
    monkeypatch.setattr(package_index, "files", unreachable)
    with pytest.raises(MachineError) as raised:
        pip.install("9.9.9", [tmp_path / wheel for wheel in wheels], tmp_path / "target")
    assert str(raised.value) == (
        "cannot install MuJoCo 9.9.9: cannot read the releases of mujoco from the package index:"
        " refused; pip says: No matching distribution found for mujoco==9.9.9"
    )


@pytest.mark.parametrize(
    ("stderr", "reason"),
    [
        ("ERROR: [Errno 28] No space left on device\\n", "[Errno 28] No space left on device"),
        ("ERROR: one\\nERROR: Exception:\\nTraceback\\nBadZipFile: bad", "one"),
        ("ERROR: Exception:\\nTraceback\\nBadZipFile: bad", "BadZipFile: bad"),
        ("No module named pip", "No module named pip"),
        ("\\377", "\N{REPLACEMENT CHARACTER}"),
        ("", "pip failed without a message"),
    ],
)
def test_another_failure_of_pip_is_one_line(
    failing_pip: Callable[[str], None], index: FullIndex, tmp_path: Path, stderr: str, reason: str
) -> None:
    failing_pip(stderr)
    index("3.3.0")
    for version, wheels in (("3.3.0", []), ("4.1.0+local", [tmp_path / "mujoco.whl"])):
        with pytest.raises(MachineError) as raised:
            pip.install(version, wheels, tmp_path / "target")
        assert str(raised.value) == f"cannot install MuJoCo {version}: {reason}"


def test_pip_dies_with_the_process_that_runs_it(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    script(tmp_path / "python", f"exec >{pipe}\necho running\nexec sleep 60\n")
    program = (
        "import sys; from pathlib import Path; from mjbench.releases import pip;"
        f" sys.executable = {str(tmp_path / 'python')!r}; pip.install('3.5.0', (), Path('target'))"
    )
    quiet = {"stdout": None, "stderr": None}
    user = started("-c", program, cwd=tmp_path, start_new_session=True, **quiet)
    with contextlib.ExitStack() as closing:
        closing.callback(user.wait)
        closing.callback(user.kill)
        reading = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
        closing.callback(os.close, reading)
        assert select.select([reading], [], [], 30)[0]
        assert os.read(reading, 100) == b"running\n"
        user.kill()
        assert select.select([reading], [], [], 30)[0], "pip lives on"
        assert os.read(reading, 100) == b""  # nobody has the pipe open for writing


def test_what_pip_started_ends_with_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    script(tmp_path / "python", f"sleep 60 &\necho $! >{tmp_path}/compiler\nexit 0\n")
    monkeypatch.setattr(sys, "executable", str(tmp_path / "python"))
    pip.build("own", Path("source"), Path("target"))
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "compiler").read_text()), 0)


def test_how_much_was_installed_is_logged_while_pip_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    os.mkfifo(tmp_path / "end")
    script(
        tmp_path / "python", f"head -c 3000000 /dev/zero >$TMPDIR/wheel\nread x <{tmp_path}/end\n"
    )
    monkeypatch.setattr(sys, "executable", str(tmp_path / "python"))
    monkeypatch.setattr(pip, "_TICK_S", 0.01)

    class Ending(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            if record.getMessage().endswith(": 3 MB"):
                with contextlib.suppress(OSError):  # it does not read yet
                    end = os.open(tmp_path / "end", os.O_WRONLY | os.O_NONBLOCK)
                    os.write(end, b"\n")
                    os.close(end)

    with caplog.at_level(logging.DEBUG, "mjbench"):
        logging.getLogger("mjbench").addHandler(handler := Ending())
        try:
            pip.install("3.5.0", (), tmp_path / "target")
        finally:
            logging.getLogger("mjbench").removeHandler(handler)
    assert caplog.messages[0] == "installing MuJoCo 3.5.0"
    assert caplog.messages[-1] == "installing MuJoCo 3.5.0: 3 MB"


def test_a_version_that_comes_from_git_is_0(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script(tmp_path / "python", 'test "$SETUPTOOLS_SCM_PRETEND_VERSION" = 0')
    monkeypatch.setattr(sys, "executable", str(tmp_path / "python"))
    assert pip.run("wheel", phase="building") == ""


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        (
            "  error: subprocess-exited\\n  own.c:2:1: error: unknown type\\n  error: gcc\\n",
            "own.c:2:1: error: unknown type",
        ),
        (
            "  error: subprocess-exited\\n  ModuleNotFoundError: No module x\\n",
            "ModuleNotFoundError",
        ),
        ("nothing\\n", "Failed to build own"),
    ],
)
def test_a_failed_build_says_what_the_compiler_says(
    failing_pip: Callable[[str], None], lines: str, expected: str
) -> None:
    failing_pip(f"{lines}ERROR: Failed to build own\\n")
    with pytest.raises(pip.BuildError, match=expected):
        pip.build("own", Path("source"), Path("target"))


def test_a_folder_that_has_gone_has_no_size(tmp_path: Path) -> None:
    (tmp_path / "wheel").write_bytes(b"12345")
    assert pip._size_bytes(tmp_path) == 5
    assert pip._size_bytes(tmp_path / "none") == 0


def test_packages_that_exclude_each_other_are_named(
    failing_pip: Callable[[str], None], tmp_path: Path
) -> None:
    conflict = "Cannot install jax==0.7.0 and jaxlib==0.9.0 because they conflict."
    failing_pip(f"ERROR: {conflict}\\nERROR: ResolutionImpossible: for help visit https://\\n")
    beside = ["jax==0.7.0", "jaxlib==0.9.0"]
    with pytest.raises(pip.BuildError) as raised:
        pip.install("4.0.0", (), tmp_path / "target", beside)
    assert str(raised.value) == (
        f"cannot install jax==0.7.0, jaxlib==0.9.0 with MuJoCo 4.0.0: {conflict}"
    )
