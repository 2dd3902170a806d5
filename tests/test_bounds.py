"""Any number in a run file is refused in one line, or is shown."""

import copy
import json
import random
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import filled_records
import pytest
from msgspec import inspect

from mjbench.commands.show import kinds, reports
from mjbench.commands.show.kinds import RECORD_TYPES
from mjbench.commands.show.reports import NamedRun
from mjbench.errors import InputError
from mjbench.results import html as html_page
from mjbench.results import markdown as markdown_page
from mjbench.results import runs, terminal
from mjbench.results.runs import Run, RunHeader

FILE = Path("x.jsonl")
# What no field may have, as it stands in the file.
BEYOND = ("1e308", "-1e308", "NaN", "Infinity", "1e999", "9" * 400)
# What some fields may have.
EXTREMES = (10**18, 1e12, 1e-300, -1, 0)
# Those that their class checks, and the version of the format, which is compared with one number.
CHECKED_ELSEWHERE = ("engine_bytes", "extension_bytes", "schema")
# Keys and positions from a record to a number.
Place = tuple[Any, ...]


def unbounded(kind: inspect.Type, name: str) -> Iterator[str]:
    """Yield the numeric fields of a type of a record that lack a bound."""
    match kind:
        case inspect.IntType() | inspect.FloatType():
            least = kind.ge if kind.gt is None else kind.gt
            most = kind.le if kind.lt is None else kind.lt
            if None in (least, most):
                yield name
        case inspect.Metadata():
            yield from unbounded(kind.type, name)
        case inspect.DataclassType():
            for each in kind.fields:
                if each.name not in CHECKED_ELSEWHERE:
                    yield from unbounded(each.type, f"{kind.cls.__name__}.{each.name}")
        case inspect.UnionType():
            for part in kind.types:
                yield from unbounded(part, name)
        case inspect.TupleType():
            for part in kind.item_types:
                yield from unbounded(part, name)
        case inspect.CollectionType():
            yield from unbounded(kind.item_type, name)
        case inspect.DictType():
            yield from unbounded(kind.value_type, name)


@pytest.mark.parametrize(
    "kind", [RunHeader, *RECORD_TYPES.values()], ids=lambda kind: kind.__name__
)
def test_every_number_of_a_record_has_bounds(kind: type) -> None:
    assert [*unbounded(inspect.type_info(kind), "")] == []


def places(value: Any, place: Place = ()) -> Iterator[Place]:
    """Yield where the numbers of a JSON value are; of a list, its first item stands for all."""
    if isinstance(value, dict):
        for key, item in value.items():
            yield from places(item, (*place, key))
    elif isinstance(value, list) and value:
        yield from places(value[0], (*place, 0))
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield place


def with_number(record: Any, at: list[Place], number: float) -> Any:
    changed = copy.deepcopy(record)
    for *parents, last in at:
        value = changed
        for key in parents:
            value = value[key]
        value[last] = number
    return changed


def parsed(*records: Any) -> Run:
    return runs.parse(FILE, [json.dumps(record).encode() for record in records], RECORD_TYPES)


def is_allowed(*records: Any) -> bool:
    try:
        parsed(*records)
    except InputError as error:
        assert len(str(error).splitlines()) == 1
        return False
    return True


def show(run: Run) -> None:
    """Show a run as `show` and `--json` do, and its rows as `mjbench.load` has them."""
    kind = kinds.kind_of(run)
    terminal.text_of(kind.sections(run))
    assert runs.to_json(kind.document(run))
    runs.to_json([*kind.rows(run)])


def write_pages(run: Run) -> None:
    """Write the pages of `show --html` and `--markdown`."""
    report = reports.build([NamedRun(FILE, run)])
    assert "".join(markdown_page.render(report))
    assert html_page.render(report)


@pytest.mark.parametrize("number", BEYOND)
def test_a_number_that_nothing_can_be_is_refused(number: str) -> None:
    header, verdict, *_ = filled_records.lines("versions")
    verdict["seconds"] = "here"
    lines = [
        json.dumps(line).replace('"here"', number).encode() for line in (header, verdict, verdict)
    ]
    with pytest.raises(InputError, match="line 2: ") as refusal:
        runs.parse(FILE, lines, RECORD_TYPES)
    assert len(str(refusal.value).splitlines()) == 1


def test_ratios_of_a_search_that_no_two_versions_have_are_refused() -> None:
    header, comparison, *_ = filled_records.lines("bisect_comparison")
    comparison["verdict"]["ratio"]["estimate"] = 1e13
    with pytest.raises(InputError, match=r"line 2: Expected `float` <= "):
        parsed(header, comparison)


@pytest.mark.parametrize("command", [name for name in filled_records.KINDS if name != "versions"])
def test_an_extreme_number_is_refused_or_shown(command: str) -> None:
    lines = filled_records.lines(command)
    for at in range(1, len(lines), 2):  # of two records of each type
        for number in EXTREMES:
            check_shown(lines, at, number, lambda record: is_allowed(lines[0], record))


@pytest.mark.parametrize("number", EXTREMES)
def test_an_extreme_number_of_a_header_is_refused_or_shown(number: float) -> None:
    check_shown(filled_records.lines("latency"), 0, number, is_allowed)


def check_shown(
    lines: list[Any], at: int, number: float, is_allowed: Callable[[Any], bool]
) -> None:
    """Check that a run is shown where fields of a line have a number: all that may, or half."""
    of_line = list(places(lines[at]))
    allowed = [place for place in of_line if is_allowed(with_number(lines[at], [place], number))]
    random.Random(0).shuffle(allowed)
    half = len(allowed) // 2
    for changed in (allowed, allowed[:half], allowed[half:]):
        run = parsed(*lines[:at], with_number(lines[at], changed, number), *lines[at + 1 :])
        show(run)
    write_pages(run)
