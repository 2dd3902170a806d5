"""Editors and mypy know the keywords of functions, which are the options of commands."""

from benchmarks.studies import function_stub


def test_the_stub_is_what_the_functions_are() -> None:
    stub = function_stub.FILE.read_text(encoding="utf-8")
    assert stub == function_stub.text(), "python -m benchmarks.studies.function_stub"
