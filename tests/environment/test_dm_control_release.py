"""A dm_control that was built for another release of MuJoCo."""

import sys
from types import SimpleNamespace

import mujoco
import pytest

from mjbench.environment import construction, dm_control_release
from mjbench.errors import InputError

CONSTANTS = "dm_control.mujoco.wrapper.mjbindings.constants"


def built_for(number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, CONSTANTS, SimpleNamespace(mjVERSION_HEADER=number))


@pytest.mark.parametrize(
    ("number", "release"), [(337, "3.3.7"), (2003007, "2.3.7"), (3017001, "3.17.1")]
)
def test_both_releases_are_said(number: int, release: str, monkeypatch: pytest.MonkeyPatch) -> None:
    built_for(number, monkeypatch)
    monkeypatch.setattr(mujoco, "mj_version", lambda: 9000000)
    monkeypatch.setattr(mujoco, "mj_versionString", lambda: "9.0.0")
    mismatch = dm_control_release.mismatch()
    assert mismatch is not None
    assert (mismatch.built_for, mismatch.installed) == (release, "9.0.0")
    assert str(mismatch).startswith(
        f"dm_control is built for MuJoCo {release}, and 9.0.0 is installed; install it with"
    )


def test_the_same_release_and_other_frameworks_are_no_mismatch(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    built_for(mujoco.mj_version(), monkeypatch)
    assert dm_control_release.mismatch() is None
    monkeypatch.delitem(sys.modules, CONSTANTS)
    assert dm_control_release.mismatch() is None


def test_what_fails_for_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    built_for(100, monkeypatch)
    with (
        pytest.raises(
            InputError, match=r"making it raised .*; dm_control is built for MuJoCo 1\.0"
        ),
        construction.as_input_error("making it"),
    ):
        raise AttributeError("no attribute flex_vertedge")
