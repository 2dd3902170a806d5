import re
from importlib import metadata
from pathlib import Path

import pytest

from benchmarks.history import known_causes
from benchmarks.history.known_causes import KnownCause
from mjbench.errors import InputError


@pytest.mark.parametrize(
    ("release", "series", "explains"),
    [
        ("1.3", "pole|rollout .*", True),
        ("1.3", "cloth", False),
        ("1.3", "pol", False),
        ("1.2", "pole", False),
    ],
)
def test_a_cause_explains_changes_of_its_release_and_models(
    release: str, series: str, explains: bool
) -> None:
    cause = KnownCause(release, series, "abc123", "more contacts")
    assert known_causes.explaining("1.3", "pole", [cause]) == [cause] * explains


@pytest.mark.parametrize(
    "entry",
    [
        'release = 3\nseries = "a"\ncommit = ""\ntext = ""',
        'release = "3.0.0"\nseries = "("\ncommit = ""\ntext = ""',
        'release = "3.0.0"',
        "\0",
    ],
)
def test_an_entry_that_is_no_cause_is_refused(tmp_path: Path, entry: str) -> None:
    file = tmp_path / "causes.toml"
    file.write_text(f"[[cause]]\n{entry}\n")
    with pytest.raises(InputError, match="cannot read"):
        known_causes.load(file)


def test_every_cause_with_a_commit_is_an_item_of_its_release_in_the_changelog() -> None:
    changelog = Path(str(metadata.distribution("mujoco").locate_file("mujoco/doc/changelog.rst")))
    if not changelog.is_file():
        pytest.skip("this MuJoCo ships no changelog")
    parts = re.split(r"^Version (\d+\.\d+\.\d+).*$", changelog.read_text(), flags=re.MULTILINE)
    sections = dict(zip(parts[1::2], parts[2::2], strict=True))
    named = [c for c in known_causes.load(known_causes.FILE) if c.commit]
    assert named
    for cause in named:
        assert cause.commit in sections[cause.release], cause


def test_a_cause_without_a_commit_says_that_it_was_measured() -> None:
    known = known_causes.load(known_causes.FILE)
    assert known
    for cause in known:
        assert cause.commit or "measuring" in cause.text, cause
