from dataclasses import replace
from pathlib import Path

import pytest

from mjbench.errors import InputError
from mjbench.host import machine
from mjbench.results import resume, runs

MACHINE = machine.describe()
FILES = (runs.InputFile("a.xml", "1f"), runs.InputFile("a.xml", "2e"))
HEADER = runs.RunHeader(runs.SCHEMA, "compare", MACHINE, {"nbatch": 4}, FILES)


def test_the_same_command_continues_a_run_whatever_the_load() -> None:
    busy = replace(HEADER, machine=replace(MACHINE, load_1min=99.0))
    resume.check_continues(Path("run"), HEADER, busy)


def test_arguments_are_compared_as_a_file_holds_them() -> None:
    now = replace(HEADER, arguments={"variants": ({"path": "a\x1bb"},)})
    stored = replace(HEADER, arguments={"variants": [{"path": "a\\x1bb"}]})
    resume.check_continues(Path("run"), stored, now)


def on(label: str, host: str) -> runs.RunHeader:
    """Return the header of a run on a machine."""
    return replace(HEADER, machine=replace(MACHINE, label=label, host=host))


@pytest.mark.parametrize(
    ("stored", "now"),
    [
        (on("", ""), on("", "a1")),
        (on("", "a1"), on("lab", "a1")),
        (on("lab", "a1"), on("lab", "b2")),  # a container, which is a new host each time
    ],
)
def test_a_run_is_continued_where_the_machine_may_be_the_same(
    stored: runs.RunHeader, now: runs.RunHeader
) -> None:
    resume.check_continues(Path("run"), stored, now)


@pytest.mark.parametrize(
    ("stored", "now", "message"),
    [
        (on("", "a1"), on("", "b2"), "the machine's host a1, and this command b2"),
        (on("lab", "a1"), on("other", "a1"), "the machine's label lab, and this command other"),
    ],
)
def test_a_run_of_another_machine_is_not_continued(
    stored: runs.RunHeader, now: runs.RunHeader, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        resume.check_continues(Path("run"), stored, now)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"command": "versions"}, "the command compare, and this command versions"),
        ({"arguments": {"nbatch": 8}}, "nbatch 4, and this command 8"),
        ({"arguments": {}}, "nbatch 4, and this command nothing"),
        ({"arguments": {"nbatch": [{"path": "rollout"}]}}, "that run has other nbatch$"),
        ({"files": FILES[:1] * 2}, "a.xml has changed"),
        ({"files": (*FILES, runs.InputFile("b.xml", ""))}, "the files"),
        ({"machine": replace(MACHINE, cpu="other")}, "the processor"),
        ({"machine": replace(MACHINE, versions={"mujoco": "1.0"})}, "mujoco"),
    ],
)
def test_what_differs_is_refused_by_name(change: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        resume.check_continues(Path("run"), HEADER, replace(HEADER, **change))  # type: ignore
