import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from mjbench.errors import MachineError
from mjbench.host import platforms
from mjbench.paired import release_python


def test_the_link_holds_mjbench_and_nothing_beside_it(tmp_path: Path) -> None:
    release_python.link_mjbench(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["mjbench"]
    assert (tmp_path / "mjbench" / "paired" / "release_python.py").samefile(release_python.__file__)


def test_a_file_system_without_links_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(path: Path, target: Path) -> None:
        raise OSError(errno.EPERM, os.strerror(errno.EPERM))

    monkeypatch.setattr(Path, "symlink_to", refuse)
    with pytest.raises(MachineError, match=r"^cannot write \S+mjbench: Operation not permitted$"):
        release_python.link_mjbench(tmp_path)


STACK_BEGIN = "print(open('/proc/self/stat').read().rpartition(')')[2].split()[25])"


@pytest.mark.skipif(not platforms.can_fix_addresses(), reason="the kernel draws addresses here")
def test_the_stack_begins_alike_however_long_arguments_and_environment_are() -> None:
    def stack_begin(stack_bytes: int, *arguments: str, **variables: str) -> int:
        command = [sys.executable, "-c", STACK_BEGIN, *arguments]
        padded = release_python.padded(command, variables, stack_bytes)
        with platforms.fixed_addresses():
            done = subprocess.run(command, env=padded, capture_output=True, check=True)
        return int(done.stdout)

    begin = stack_begin(0)
    assert stack_begin(0, "a long argument" * 9) == begin
    assert stack_begin(0, *"many arguments", NAME="value") == begin
    assert stack_begin(160) == begin - 160
