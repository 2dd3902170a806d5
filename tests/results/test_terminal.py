"""Foreign text cannot change the terminal: names, messages and stored texts print as they are."""

import fcntl
import io
import logging
import os
import re
import struct
import subprocess
import sys
import termios

import pytest
from commands import PYTHONPATH, ROOT, mjbench
from rich.console import Console, Group

from mjbench import formats
from mjbench.cli.progress import progress
from mjbench.errors import one_line, printable
from mjbench.formats import plain
from mjbench.results import terminal
from mjbench.results.content import Column, Conclusion, DataTable, Section, Tone
from mjbench.simulation import engine_warnings

# It writes the clipboard of many terminals.
CLIPBOARD = "\x1b]52;c;cm0=\x07"
HOSTILE = ["\x1b[2J", CLIPBOARD, "\x9b31m", "a\rb", "\u202eabc", "\udce9", "\x00", "[red]x[/red]"]


def printed(content: object) -> str:
    """Return what a console on a terminal writes."""
    out = terminal.console()
    out.file, out._force_terminal = io.StringIO(), True
    out.print(content)
    return out.file.getvalue()


def table_of(text: str) -> object:
    return Group(*terminal.table_parts(DataTable("", [Column("name")], [[text]]), 80))


@pytest.mark.parametrize("text", HOSTILE)
@pytest.mark.parametrize(
    "content",
    [str, table_of, lambda text: terminal.headed(text, text)],
    ids=["line", "cell", "head"],
)
def test_foreign_text_reaches_the_terminal_escaped(content: object, text: str) -> None:
    assert callable(content)
    out = printed(content(text))
    assert printable(text) in out
    assert text in out if text.isprintable() else text not in out


def test_text_of_several_lines_stays_so() -> None:
    assert printed("a\nb\n\tc").splitlines() == ["a", "b", "\\tc"]


def test_printable_text_is_left_alone() -> None:
    assert printable("C:\\robots\\größe×2 → 3 µs") == "C:\\robots\\größe×2 → 3 µs"


def test_a_message_is_one_printable_line() -> None:
    assert one_line("a\n  b\x1b[1mc") == "a b\\x1b[1mc"


def test_numbers_are_written_without_exponents() -> None:
    for value, digits, text in [
        (1.4, 2, "1.4"),
        (99.6, 2, "100"),
        (153.7, 2, "154"),
        (0.000012, 2, "0.000012"),
        (0.0, 2, "0"),
        (-1234.5, 3, "-1234"),
        (999.6, 3, "1000"),
        (float("inf"), 2, "inf"),
    ]:
        assert plain(value, digits) == text
    assert [formats.factor(ratio) for ratio in (1.234, 0.1, 0.04, 0.00004)] == [
        *("1.23", "0.10", "0.04", "0.00004")
    ]


def test_full_memory_is_said_apart_from_other_warnings() -> None:
    full, other = engine_warnings.warning_lines({"CNSTRFULL": 64, "INERTIA": 1})
    assert full.startswith("The model's memory was full (CNSTRFULL in 64 simulations)")
    assert other == "MuJoCo warned (INERTIA in 1 simulation) but the simulations did not diverge"
    assert engine_warnings.warning_lines({}) == engine_warnings.warning_lines(None) == []


def test_no_number_of_a_table_is_cut_however_narrow_the_console() -> None:
    row = ("a name that is longer than the console " * 2, 123_456_789.0, "slower by its code" * 2)
    columns = [Column("name", wraps=True), Column("ns", formats.count), Column("verdict")]
    out = terminal.console()
    out.file, out.width = io.StringIO(), 40
    terminal.print_sections(out, [Section("s", tables=[DataTable("t", columns, [row])])])
    text = out.file.getvalue()
    assert "123,456,789" in text
    assert {"codeslower", "its", "code"} <= set(text.split())


def test_the_heading_names_what_sentences_leave_out() -> None:
    caution = Conclusion("measured beside another mjbench", Tone.CAUTION)
    for conclusions in ([caution], [caution, Conclusion("m: fast", subject="m")]):
        text = terminal.text_of([Section("m: 8 simulations", conclusions)])
        assert text.splitlines()[:2] == ["measured beside another mjbench", "m: 8 simulations"]
    assert "m: 8" not in terminal.text_of([Section("m: 8", [Conclusion("m: fast")])])


# terminals


def on_a_terminal(words: list[str], width: int, **env: str) -> str:
    """Return what a command writes to a terminal of some width."""
    leader, follower = os.openpty()
    fcntl.ioctl(follower, termios.TIOCSWINSZ, struct.pack("HHHH", 40, width, 0, 0))
    variables = {k: v for k, v in os.environ.items() if k not in ("COLUMNS", "NO_COLOR")}
    with subprocess.Popen(
        [sys.executable, "-m", "mjbench", *words],
        stdout=follower,
        stderr=subprocess.DEVNULL,
        env={**variables, "TERM": "xterm-256color", "PYTHONPATH": PYTHONPATH, **env},
    ):
        os.close(follower)
        chunks = []
        while chunk := _read(leader):
            chunks.append(chunk)
    os.close(leader)
    return b"".join(chunks).decode().replace("\r\n", "\n")


def _read(descriptor: int) -> bytes:
    try:
        return os.read(descriptor, 4096)
    except OSError:  # the other end is closed
        return b""


def test_a_narrow_terminal_wraps_sentences_at_words() -> None:
    run = str(ROOT / "results/runs/reference-mujoco-4.0.0.jsonl")
    text = re.sub(r"\x1b\[[\d;]*m", "", on_a_terminal(["show", run], 60))
    assert max(map(len, text.splitlines())) <= 60
    whole = " ".join(mjbench("show", run).stdout.split())
    sentence = next(s for s in whole.split("For ") if s.startswith("RL (closed loop)"))
    assert sentence in " ".join(text.split())


def test_no_color_means_no_colours() -> None:
    words = ["show", str(ROOT / "results/runs/reference-story-versions.jsonl")]
    assert not re.search(r"\x1b\[3\d", on_a_terminal(words, 80, NO_COLOR="1"))
    assert "\x1b" not in on_a_terminal(words, 80, TERM="dumb")


@pytest.mark.parametrize("name", [":ant:", "[red]", "机器人" * 20])
def test_a_bar_shows_names_as_they_are_and_cuts_no_time(name: str) -> None:
    out = Console(file=io.StringIO(), width=60, force_terminal=True)
    with progress(out) as bar:
        bar(name, 0.5)
    text = re.sub(r"\x1b\[[\d;]*m", "", out.file.getvalue())  # type: ignore[attr-defined]
    assert name[:4] in text
    assert re.search(r"\d:\d\d:\d\d left", text)


def test_what_is_logged_is_a_phase_and_a_warning_a_line_without_a_bar_before_it(
    capsys: pytest.CaptureFixture[str],
) -> None:
    logger = logging.getLogger("mjbench.releases.installs")
    out = Console(file=io.StringIO(), width=80, force_terminal=True)
    with progress(out) as bar:
        logger.info("installing MuJoCo %s", "3.16.0")
        logger.debug("installing MuJoCo %s: %d MB", "3.16.0", 12)
        bar.show(None)
        logger.warning("mjbench: a file has been changed")
    text = out.file.getvalue()  # type: ignore[attr-defined]
    assert "installing MuJoCo 3.16.0 " in text
    assert "installing MuJoCo 3.16.0: 12 MB" in text
    assert "\x1b[2K" in text  # the bar is gone
    with progress(Console(file=io.StringIO())):
        logger.info("installing MuJoCo %s", "3.17.0")
        logger.debug("installing MuJoCo %s: %d MB", "3.17.0", 12)
    assert capsys.readouterr().err == "mjbench: a file has been changed\ninstalling MuJoCo 3.17.0\n"


def test_a_bar_leaves_a_table_rather_than_wraps() -> None:
    columns = [Column("a name that is long"), Column("share", formats.percent)]
    table = DataTable("", [*columns, Column("", is_bar=True)], [["stage", 0.9, 27 * "█"]])
    out = terminal.console()
    for width, is_there in ((60, True), (50, False)):
        parts = list(terminal.table_parts(table, width))
        with out.capture() as captured:
            terminal.print_lines(out, parts)
        assert ("█" in captured.get()) == is_there
        assert len(captured.get().splitlines()) == 2
