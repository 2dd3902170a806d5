"""Linux without what macOS or Windows lack, to see how commands end there.

`sys.platform` names the other system, and functions, modules and files that it lacks are hidden.
The packages that mjbench uses stay those of Linux: they are imported before, or ask `os.name` and
`platform.system()`, which stay as they are.
"""

import contextlib
import ctypes
import importlib
import json
import os
import select
import signal
import subprocess
import sys
import sysconfig
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

TESTS = Path(__file__).parent
ROOT = TESTS.parent

_LINUX_FOLDERS = ("/proc", "/sys")
_LINUX_CALLS = ("prctl", "personality", "sched_setaffinity")
_NOT_ON_MACOS = ("sched_", "pidfd_", "memfd_", "eventfd", "posix_fadvise", "setns", "unshare")
_NOT_ON_WINDOWS = (
    *_NOT_ON_MACOS,
    *("chown", "fchown", "lchown", "fork", "getegid", "geteuid", "getgid", "getgroups"),
    *("getloadavg", "getpgid", "getpgrp", "getpriority", "getsid", "getuid", "killpg", "mkfifo"),
    *("nice", "openpty", "posix_spawn", "pread", "pwrite", "setegid", "seteuid", "setgid"),
    *("setpgid", "setpgrp", "setpriority", "setsid", "setuid", "statvfs", "sysconf", "uname"),
    *("wait3", "wait4", "waitid", "WNOHANG"),
)
_SIGNALS_OF_WINDOWS = ("SIGABRT", "SIGFPE", "SIGILL", "SIGINT", "SIGSEGV", "SIGTERM")
_MODULES_OF_POSIX = ("crypt", "fcntl", "grp", "nis", "pty", "pwd", "resource", "spwd", "syslog")
_MODULES_OF_POSIX += ("termios", "tty")
# What mjbench imports from elsewhere, as far as it depends on the system.
_PACKAGES = ("click.testing", "mujoco.batch", "mujoco.rollout", "multiprocessing.connection")
_PACKAGES += ("msgspec", "platformdirs", "psutil", "rich.progress", "scipy.stats")


@dataclass(frozen=True)
class Ended:
    """How a command ended."""

    code: int
    stdout: str
    stderr: str


def environment(platform: str) -> dict[str, str]:
    """Return the environment of processes that run as if on `platform`."""
    folders = (TESTS / "hidden_facilities", ROOT, TESTS)
    return {
        **os.environ,
        "MJBENCH_TEST_PLATFORM": platform,
        # where Python finds what it was built with, which it looks for by the name of the system
        "_PYTHON_SYSCONFIGDATA_NAME": sysconfig._get_sysconfigdata_name(),  # type: ignore
        "PYTHONPATH": os.pathsep.join(map(str, folders)),
    }


def commands(
    platform: str, command_lines: Mapping[str, Sequence[str]], cwd: Path
) -> dict[str, Ended]:
    """Return how commands end, all run in one process as if on `platform`.

    Args:
      platform: `darwin` or `win32`.
      command_lines: the words of each, by any name.
      cwd: the current folder.
    """
    done = subprocess.run(
        [sys.executable, "-c", "import other_platforms; other_platforms.main()"],
        input=json.dumps(command_lines),
        env={**environment(platform), "TMPDIR": str(cwd)},  # for the details of errors
        cwd=cwd,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    return {name: Ended(*ended) for name, ended in json.loads(done.stdout).items()}


def main() -> None:
    """Run the commands that standard input names; print how they ended."""
    command_lines = json.load(sys.stdin)
    if os.environ["MJBENCH_TEST_PLATFORM"] == "win32":
        _hide_what_windows_lacks()
    from click.testing import CliRunner

    from mjbench.cli import cli

    ended = {}
    for name, words in command_lines.items():
        result = CliRunner().invoke(cli, words)
        ended[name] = (result.exit_code, result.stdout, result.stderr)
    print(json.dumps(ended))


def hide_what_macos_lacks() -> None:
    """Make this process one of macOS, as far as mjbench can see."""
    with contextlib.suppress(ImportError):  # reads /proc, and asks for the system when imported
        import psutil  # noqa: F401
    sys.platform = "darwin"
    sys.modules["_scproxy"] = _SystemProxies("_scproxy")
    _remove(os, _NOT_ON_MACOS)
    _remove(select, ("epoll",))
    _hide_calls_of_linux()
    sys.addaudithook(_hide_files_of_linux)
    readlink: Any = os.readlink

    def readlink_elsewhere(path: Any, *arguments: Any, **options: Any) -> Any:
        _hide_files_of_linux("open", (path,))
        return readlink(path, *arguments, **options)

    os.readlink = readlink_elsewhere


class _SystemProxies(ModuleType):
    """The module of macOS that urllib asks for proxies; there are none."""

    def __getattr__(self, name: str) -> Any:
        return dict


def _hide_what_windows_lacks() -> None:
    """Make this process one of Windows, as far as mjbench can see. It can start no process."""
    for package in _PACKAGES:
        importlib.import_module(package)
    sys.platform = "win32"
    for module in _MODULES_OF_POSIX:
        sys.modules[module] = None  # type: ignore[assignment]
    _remove(os, _NOT_ON_WINDOWS)
    _remove(signal, [s for s in dir(signal) if _is_posix_signal(s)])
    _remove(signal, ("alarm", "pthread_", "setitimer", "siginterrupt", "sigpending", "sigwait"))
    _hide_calls_of_linux()
    sys.addaudithook(_hide_files_of_linux)
    sys.addaudithook(_forbid_processes)


def _is_posix_signal(name: str) -> bool:
    is_signal = name.startswith("SIG") and not name.startswith("SIG_")
    return is_signal and name not in _SIGNALS_OF_WINDOWS


def _remove(module: Any, prefixes: Iterable[str]) -> None:
    """Remove what begins with one of the prefixes from a module."""
    for name in dir(module):
        if name.startswith(tuple(prefixes)):
            delattr(module, name)


def _hide_calls_of_linux() -> None:
    """Remove functions of Linux from what ctypes finds."""
    find = ctypes.CDLL.__getattr__

    def find_others(library: ctypes.CDLL, name: str) -> Any:
        if name in _LINUX_CALLS:
            raise AttributeError(name)
        return find(library, name)

    ctypes.CDLL.__getattr__ = find_others  # type: ignore[method-assign]


def _hide_files_of_linux(event: str, arguments: Any) -> None:
    """Refuse to open files of Linux, except for psutil, which stays that of Linux."""
    if event not in ("open", "os.listdir", "os.scandir") or not isinstance(
        arguments[0], str | os.PathLike
    ):
        return
    path = os.fspath(arguments[0])
    callers = (sys._getframe(1), sys._getframe(1).f_back)
    is_psutil = any(c and c.f_globals.get("__name__", "").startswith("psutil") for c in callers)
    if path.startswith(_LINUX_FOLDERS) and not is_psutil:
        raise FileNotFoundError(2, "no such file on this system", path)


def _forbid_processes(event: str, arguments: Any) -> None:
    # os.kill(pid, 0), which only asks on Linux, sends Ctrl-C on Windows
    if event in ("subprocess.Popen", "os.fork", "os.posix_spawn", "os.kill"):
        raise AssertionError(f"{event} while it runs as if on Windows")
