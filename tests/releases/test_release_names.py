"""What a name of a release means: versions, words, wheels; and what names none."""

from datetime import datetime

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjbench.errors import InputError, MachineError
from mjbench.releases import package_index, release_names
from mjbench.releases.release import Release


@pytest.mark.parametrize(
    ("text", "release"),
    [
        ("3.5.0", True),
        ("v3.5.0", True),
        ("4.1.0rc1", True),
        ("2.3.1.post1", True),
        ("4.1.0.dev20260101", True),
        ("4.1.0+g1a2b3c", True),
        ("installed", True),
        ("dist/mujoco-4.1.0-cp311-cp311-linux_x86_64.whl", True),
        ("3.5", True),
        ("cartpole", False),
        ("robot.xml", False),
        ("3", False),
        ("v3", False),
        ("3.x", False),
    ],
)
def test_releases_are_distinguished_from_models(text: str, release: bool) -> None:
    assert release_names.is_release(text) is release


@pytest.mark.parametrize(
    ("text", "version"),
    [
        ("3.5.0", "3.5.0"),
        ("v3.5.0", "3.5.0"),
        ("3.5", "3.5.0"),
        ("v3.5", "3.5.0"),
        ("3.5rc1", "3.5.0rc1"),
        ("4.1.0rc1", "4.1.0rc1"),
        ("4.1.0.dev3", "4.1.0.dev3"),
        ("4.1.0dev3", "4.1.0.dev3"),
        ("2.3.7.post1", "2.3.7.post1"),
        ("4.1.0+g1a2b3c", "4.1.0+g1a2b3c"),
    ],
)
def test_a_version_is_read_as_packaging_reads_it_and_a_short_one_is_the_first_of_its_minor(
    text: str, version: str
) -> None:
    release = release_names.parse_release(text)
    assert release.version == version
    assert release.key.startswith(f"{version}-cpython-")


@pytest.mark.parametrize(
    "text", ["3", "cartpole", "", " ", "1." + "9" * 5000, "a\0b", "no/such/mujoco-3.5.0.whl"]
)
def test_what_names_no_release_is_refused_with_what_was_given(text: str) -> None:
    with pytest.raises(
        InputError, match=r"is not a release: give a version|no such wheel"
    ) as raised:
        release_names.parse_release(text)
    assert text[:20] in str(raised.value).replace(r"\x00", "\0")
    assert len(str(raised.value)) < 250


def test_a_misspelt_word_is_corrected() -> None:
    with pytest.raises(
        InputError, match=r"'instaled' is not a release \(did you mean installed\?\)"
    ):
        release_names.parse_release("instaled")


@pytest.mark.parametrize("text", ["2.3.6", "2.3.1.post1", "v2.2", "2.3.5"])
def test_a_release_that_is_too_old_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"is too old: 2\.3\.7 is the oldest that can be measured"):
        release_names.parse_release(text)


@settings(deadline=None)
@given(
    st.text()
    | st.text("0123456789.vrc+!-_ ab", max_size=12)
    | st.from_regex(r"mujoco-[0-9.]{0,6}(-[a-z0-9_.]{0,9}){0,3}\.whl", fullmatch=True)
    | st.text(st.sampled_from("ab./~*[]\0\n"), max_size=9).map("{}.whl".format)
)
def test_any_text_is_a_release_or_an_input_error(text: str) -> None:
    named = release_names.is_release(text)
    try:
        release = release_names.parse_release(text)
    except InputError as error:
        assert str(error).isprintable()
    else:
        assert named
        assert release_names.parse_release(release.version).version == release.version


def test_the_environments_own_release_is_not_the_same_one_of_the_index() -> None:
    here = release_names.parse_release("installed")
    assert here.key != release_names.parse_release(here.version).key


def test_the_newest_release_and_the_one_before_are_those_of_the_index(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    releases = [Release(version, datetime(2026, 1, 1)) for version in ("3.10.0", "3.9.0")]
    monkeypatch.setattr(package_index, "releases", lambda: releases)
    assert release_names.parse_release("newest").version == "3.10.0"
    assert release_names.parse_release("previous").version == "3.9.0"
    for known, name in (([], "newest"), (releases[:1], "previous")):
        monkeypatch.setattr(package_index, "releases", lambda known=known: known)
        with pytest.raises(MachineError, match=f"the package index has no {name} release of muj"):
            release_names.parse_release(name)
