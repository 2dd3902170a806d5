"""What documents and tables have of a result: its fields, or what its class declares."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

from mjbench.results.json_form import in_json, json_form


@in_json("name", "ns", "count", ns="median_ns")
@dataclass(frozen=True)
class Timed:
    ns: Sequence[int]
    name: str = "loop"

    @cached_property
    def median_ns(self) -> float | None:
        return self.ns[len(self.ns) // 2] if self.ns else None

    @property
    def count(self) -> int:
        return len(self.ns)


@in_json(also=["length"])
@dataclass(frozen=True)
class Plain:
    name: str

    @property
    def length(self) -> int:
        return len(self.name)


@dataclass(frozen=True)
class Document:
    results: Sequence[Timed]
    first: Timed | None = None
    others: dict[str, Plain] = field(default_factory=dict)
    schema: int = 1


def test_a_result_has_the_fields_and_figures_that_its_class_declares() -> None:
    assert list(json_form(Timed([1, 2, 3])).items()) == [("name", "loop"), ("ns", 2), ("count", 3)]
    assert json_form(Plain("loop")) == {"name": "loop", "length": 4}


def test_results_inside_a_document_have_their_forms() -> None:
    timed = Timed([5])
    assert json_form(Document([timed], timed, {"a": Plain("b")})) == {
        "results": [{"name": "loop", "ns": 5, "count": 1}],
        "first": {"name": "loop", "ns": 5, "count": 1},
        "others": {"a": {"name": "b", "length": 1}},
        "schema": 1,
    }
