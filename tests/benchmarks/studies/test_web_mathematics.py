"""Whether builds differ from C by their mathematics library alone."""

import ctypes
import math
from pathlib import Path
from typing import Any

import pytest

from benchmarks.studies import web_mathematics
from benchmarks.studies.web_mathematics import ModelDifference
from mjbench.errors import MachineError


def document(first: dict[str, Any] | None, difference: float) -> dict[str, Any]:
    check = {"first": first, "points": [{"difference": 0.0}, {"difference": difference}]}
    paths = [{"check": None}, {"check": check}]
    return {"results": [{"model": "humanoid", "detail": "", "paths": paths}]}


def test_two_documents_say_what_differs_with_each_library() -> None:
    differences = web_mathematics.compared(document({"step": 7}, 2e-16), document(None, 0.0))
    assert differences == [ModelDifference("humanoid", 7, None, 2e-16)]


def test_a_model_that_was_not_compared_is_an_error() -> None:
    empty = {"results": [{"model": "humanoid", "detail": "killed", "paths": [{"check": None}]}]}
    with pytest.raises(MachineError, match="humanoid was not compared: killed"):
        web_mathematics.compared(empty, empty)


def test_the_library_has_functions_that_round_otherwise(tmp_path: Path) -> None:
    try:
        library = ctypes.CDLL(str(web_mathematics.build(tmp_path)))
    except MachineError as error:
        pytest.skip(str(error))
    sine = library.sin
    sine.restype, sine.argtypes = ctypes.c_double, [ctypes.c_double]
    angles = [0.001 * i for i in range(3000)]
    largest = max(abs(sine(angle) - math.sin(angle)) for angle in angles)
    assert 0 < largest < 1e-15
