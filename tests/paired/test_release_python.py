import errno
import os
from pathlib import Path

import pytest

from mjbench.errors import MachineError
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
