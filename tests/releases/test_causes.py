import re
from importlib import metadata
from pathlib import Path

import pytest
from commands import ROOT
from histories import timed
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mjbench.errors import InputError
from mjbench.releases import causes
from mjbench.releases.causes import Cause
from mjbench.releases.history import ChangePoint


@pytest.mark.parametrize(
    ("release", "where", "explains"),
    [
        ("1.3", r"step.* \(pole\)", True),
        ("1.3", r"step.* \(cloth\)", False),
        ("1.2", r"step.* \(pole\)", False),
    ],
)
def test_a_cause_explains_change_points_of_its_release_and_benchmarks(
    release: str, where: str, explains: bool
) -> None:
    change_point = ChangePoint(timed(1.0), "1.2", "1.3", 1.5, ())
    cause = Cause(release, where, "abc123", "more contacts")
    assert causes.explaining(change_point, [cause]) == [cause] * explains


def test_an_entry_that_lacks_something_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "causes.toml"
    file.write_text('[[cause]]\nrelease = "3.0.0"\n')
    with pytest.raises(InputError, match=r"cannot read .*causes\.toml"):
        causes.load(file)


@pytest.mark.parametrize(
    "entry",
    [
        'release = 3\nwhere = "a"\ncommit = ""\ntext = ""',
        'release = "3.0.0"\nwhere = "("\ncommit = ""\ntext = ""',
        'where = ["a"]',
        "\0",
    ],
)
def test_an_entry_of_other_types_or_without_a_regular_expression_is_refused(
    tmp_path: Path, entry: str
) -> None:
    file = tmp_path / "causes.toml"
    file.write_text(f"[[cause]]\n{entry}\n")
    with pytest.raises(InputError, match="cannot read"):
        causes.load(file)


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.one_of(st.binary(max_size=40), st.text(max_size=40).map(str.encode)))
def test_any_file_is_a_table_of_causes_or_an_input_error(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "causes.toml"
    file.write_bytes(b"[[cause]]\n" + content)
    with pytest.raises(InputError):
        causes.load(file)


def test_a_missing_file_is_named_once(tmp_path: Path) -> None:
    file = tmp_path / "causes.toml"
    with pytest.raises(InputError) as raised:
        causes.load(file)
    assert str(raised.value) == f"cannot read {file}: No such file or directory"


def test_every_cause_with_a_commit_is_an_item_of_its_release_in_the_changelog() -> None:
    changelog = Path(str(metadata.distribution("mujoco").locate_file("mujoco/doc/changelog.rst")))
    if not changelog.is_file():
        pytest.skip("this MuJoCo ships no changelog")
    parts = re.split(r"^Version (\d+\.\d+\.\d+).*$", changelog.read_text(), flags=re.MULTILINE)
    sections = dict(zip(parts[1::2], parts[2::2], strict=True))
    named = [c for c in causes.load(ROOT / "benchmarks/causes.toml") if c.commit]
    assert named
    for cause in named:
        assert cause.commit in sections[cause.release], cause


def test_a_cause_without_a_commit_says_that_it_was_measured() -> None:
    known = causes.load(ROOT / "benchmarks/causes.toml")
    assert known
    for cause in known:
        assert cause.commit or "measuring" in cause.text, cause
