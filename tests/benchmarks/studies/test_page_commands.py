"""Which examples a page has, and how a command has ended."""

import signal

import pytest

from benchmarks.studies import page_commands
from benchmarks.studies.page_commands import Example, Kind, Outcome, Readers, examples_of, outcome

PAGE = """Look with `mjbench env Humanoid-v5`, or `mjbench
tune robot.xml`; `mjbench run` and `mjbench versions OLD NEW robot.xml` are names.

```
mjbench compare robot.xml   # a comment
python train.py
```

<!-- of results/runs/reference-x.jsonl -->
```
what a command printed
```

```python
# bench.py
def step(): ...
```

```python
import mjbench
```

```yaml
# .github/workflows/x.yml
```
"""


def test_the_examples_of_a_page_are_commands_files_and_programs_in_their_order() -> None:
    assert list(examples_of(PAGE)) == [
        Example(Kind.COMMAND, "mjbench env Humanoid-v5"),
        Example(Kind.COMMAND, "mjbench tune robot.xml"),
        Example(Kind.COMMAND, "mjbench compare robot.xml   # a comment"),
        Example(Kind.COMMAND, "python train.py"),
        Example(Kind.FILE, "# bench.py\ndef step(): ...\n", "bench.py"),
        Example(Kind.PROGRAM, "import mjbench\n"),
    ]


TRACEBACK = "Traceback (most recent call last):"


@pytest.mark.parametrize(
    ("line", "code", "printed", "is_interrupted", "expected"),
    [
        ("mjbench compare robot.xml", 0, "", False, Outcome.RAN),
        ("mjbench compare robot.xml", 1, "", False, Outcome.FAILED),
        ("mjbench versions a b --fail-on slower", 1, "", False, Outcome.RAN),
        ("mjbench lint train.py", 1, "", False, Outcome.RAN),
        ("mjbench lint train.py", 2, "", False, Outcome.FAILED),
        ("mjbench env x", 3, "dm_control is missing: pip install dm_control", False, Outcome.LACKS),
        ("mjbench env x", 3, "it crashed", False, Outcome.FAILED),
        ("mjbench tune robot.xml", 130, "", True, Outcome.INTERRUPTED),
        ("mjbench tune robot.xml", 1, TRACEBACK, True, Outcome.FAILED),
        ("python walk_env.py", 1, TRACEBACK, True, Outcome.INTERRUPTED),
    ],
)
def test_a_command_has_failed_unless_its_exit_code_is_an_answer(
    line: str, code: int, printed: str, is_interrupted: bool, expected: Outcome
) -> None:
    assert outcome(line, code, printed, is_interrupted) == expected


def test_commands_can_be_interrupted_where_the_shell_ignores_ctrl_c(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    handlers: list[object] = []

    def check(*_: object) -> bool:
        handlers.append(signal.getsignal(signal.SIGINT))
        return True

    monkeypatch.setattr(Readers, "make", lambda _: None)
    monkeypatch.setattr(page_commands, "check", check)
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        assert page_commands.main(["README.md"]) == 0
    finally:
        signal.signal(signal.SIGINT, before)
    assert handlers == [signal.default_int_handler]
