"""Code of two releases, compared by the functions that each executes."""

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path

import pytest
from assembly import ADD, COPY, LOAD_FAR_FIELD, LOAD_FIELD, RETURN, ROOT, SUBTRACT, call, library

from mjbench.counts import code_comparison, shared_library
from mjbench.counts.callgrind import CodePlace
from mjbench.counts.code_comparison import Places, compare, renamed_functions
from mjbench.counts.machine_code import Instruction, Surroundings, decode
from mjbench.counts.records import CodeChange
from mjbench.counts.shared_library import SharedLibrary
from mjbench.errors import MachineError

OLD, NEW, LIBC = "/old/libmujoco.so.1", "/new/libmujoco.so.2", "/lib/libc.so.6"
STEP = LOAD_FIELD + RETURN
LONG = (LOAD_FIELD + ADD + SUBTRACT + COPY + ROOT) * 3 + RETURN
LONGER = ROOT + LONG


def executed(file: str, library: SharedLibrary, *names: str) -> dict[str, list[CodePlace]]:
    """Return the places of functions by symbol name; `shown=symbol` shows another name."""
    pairs = [name.partition("=") for name in ("mj_step", *names)]
    return {
        shown: [CodePlace(file, (library.named(symbol or shown)[0].address,))]
        for shown, _, symbol in pairs
    }


def compared(
    old: Mapping[str, bytes],
    new: Mapping[str, bytes],
    old_names: tuple[str, ...],
    new_names: tuple[str, ...],
    elsewhere: tuple[Places, Places] = ({}, {}),
) -> tuple[dict[str, CodeChange], dict[str, str]]:
    libraries = {
        Path(OLD): library({"mj_step": STEP, **old}),
        Path(NEW): library({"mj_step": STEP, **new}, base=0x7770),
    }
    places = [
        {**executed(file, libraries[Path(file)], *names), **others}
        for file, names, others in zip((OLD, NEW), (old_names, new_names), elsewhere, strict=True)
    ]
    changes = compare(*places, libraries.__getitem__)
    return dict(changes.changes), dict(changes.old_names)


def test_functions_are_matched_by_name() -> None:
    old = {"same": LONG, "grown": LOAD_FIELD + RETURN, "other": ADD + RETURN, "left": ROOT}
    new = {"same": LONG, "grown": LOAD_FAR_FIELD + RETURN, "other": COPY + RETURN, "added": ADD}
    changes, old_names = compared(old, new, tuple(old), tuple(new))
    assert changes == {
        "mj_step": CodeChange.IDENTICAL,
        "same": CodeChange.IDENTICAL,
        "grown": CodeChange.OFFSETS,
        "other": CodeChange.CHANGED,
        "left": CodeChange.GONE,
        "added": CodeChange.NEW,
    }
    assert old_names == {}


def test_a_function_that_only_one_release_executes_is_found_in_the_other() -> None:
    functions = {"f": LONG, "g": LONGER}
    changes, _ = compared(functions, {**functions, "g": ROOT}, ("f",), ("g",))
    assert changes["f"] is CodeChange.IDENTICAL
    assert changes["g"] is CodeChange.CHANGED


def test_a_renamed_function_is_matched_by_its_code() -> None:
    changes, old_names = compared({"f": LONG}, {"mj_f": LONGER}, ("f",), ("mj_f",))
    assert changes == {"mj_step": CodeChange.IDENTICAL, "mj_f": CodeChange.CHANGED}
    assert old_names == {"mj_f": "f"}


def test_a_renamed_function_may_take_the_name_of_another_one() -> None:
    old, new = {"f": LONG, "mj_f": ADD + RETURN}, {"mj_f": LONG}
    changes, old_names = compared(old, new, ("f",), ("mj_f",))
    assert (changes["mj_f"], old_names) == (CodeChange.IDENTICAL, {"mj_f": "f"})


def test_callers_of_a_renamed_function_are_identical() -> None:
    def caller(base: int) -> bytes:  # behind mj_step, 16 bytes long with its padding
        return call(base + 32, base + 16) + RETURN

    changes, _ = compared(
        {"caller": caller(0x1000), "f": LONG},
        {"caller": caller(0x7770), "mj_f": LONG},
        ("caller", "f"),
        ("caller", "mj_f"),
    )
    assert changes["caller"] is CodeChange.IDENTICAL


def test_short_functions_are_not_matched_by_their_code() -> None:
    changes, old_names = compared({"f": STEP}, {"g": STEP}, ("f",), ("g",))
    assert (changes["f"], changes["g"], old_names) == (CodeChange.GONE, CodeChange.NEW, {})


def test_names_may_differ_from_those_of_symbols() -> None:
    mangled = {"_ZN2mj1fEv": LONG}
    changes, _ = compared(mangled, mangled, ("mj::f()=_ZN2mj1fEv",), ("mj::f()=_ZN2mj1fEv",))
    assert changes["mj::f()"] is CodeChange.IDENTICAL


def test_clones_made_by_the_compiler_are_compared_with_their_function() -> None:
    old, new = {"f.llvm.12": LONG}, {"f.llvm.3456": LONG}
    changes, _ = compared(old, new, ("f",), ("f",))
    assert changes["f"] is CodeChange.IDENTICAL


def test_a_function_in_another_library_is_known_by_its_file() -> None:
    libc = {"memcpy": [CodePlace(LIBC, (8,))]}
    unnamed = {"0x10": [CodePlace("/new/_structs.so", (16,))]}
    changes, _ = compared({}, {}, (), (), (libc, {**libc, **unnamed}))
    assert changes["memcpy"] is CodeChange.IDENTICAL
    assert changes["0x10"] is CodeChange.UNKNOWN


def test_without_addresses_there_is_nothing_to_compare() -> None:
    with pytest.raises(MachineError, match="Callgrind does not say"):
        compare({"mj_step": [CodePlace(OLD, ())]}, {})


def test_a_library_is_read_once_while_it_is_compared_and_again_after_many_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    files = [f"/{number}/libmujoco.so.1" for number in range(5)]
    content = library({"mj_step": STEP})
    read: list[str] = []

    def reading(file: Path) -> SharedLibrary:
        read.append(str(file))
        return content

    monkeypatch.setattr(shared_library, "read", reading)
    for old, new in pairwise(files):
        for _ in range(2):
            compare(executed(old, content), executed(new, content))
    assert read == files
    compare(executed(files[0], content), executed(files[4], content))
    assert read == [*files, files[0]]


# renamed functions


def decoded(*code: bytes) -> list[Instruction]:
    return decode(b"".join(code), 0x1000, Surroundings())


SUMS = decoded(*[ADD, SUBTRACT, COPY, LOAD_FIELD] * 4, RETURN)
SUMS_AND_ROOT = decoded(ROOT, *[ADD, SUBTRACT, COPY, LOAD_FIELD] * 4, RETURN)
ROOTS = decoded(*[ROOT, LOAD_FIELD] * 8, RETURN)


def test_each_function_is_matched_with_the_most_similar_one() -> None:
    gone = {"f": SUMS, "g": SUMS_AND_ROOT, "h": ROOTS}
    new = {"mj_g": SUMS_AND_ROOT, "mj_f": SUMS, "mj_h": decoded(ADD, RETURN)}
    assert renamed_functions(gone, new) == {"f": "mj_f", "g": "mj_g"}


def test_of_functions_of_equal_code_the_similar_name_decides() -> None:
    assert renamed_functions({"copyRow": SUMS}, {"advance": SUMS, "mj_copyRow": SUMS}) == {
        "copyRow": "mj_copyRow"
    }


def test_a_like_name_needs_less_similar_code() -> None:
    half = decoded(*[ADD, SUBTRACT, COPY, LOAD_FIELD] * 2, *[ROOT, LOAD_FIELD] * 4, RETURN)
    assert renamed_functions({"mj_copyRow": SUMS}, {"mj_copyRows": half}) == {
        "mj_copyRow": "mj_copyRows"
    }
    assert renamed_functions({"mj_copyRow": SUMS}, {"advance": half}) == {}
    assert renamed_functions({"mj_copyRow": SUMS}, {"mj_copyRows": ROOTS}) == {}


def test_short_functions_are_not_matched() -> None:
    assert renamed_functions({"f": SUMS[:9]}, {"g": SUMS[:9]}) == {}
    assert renamed_functions({"f": SUMS[:10]}, {"g": SUMS[:10]}) == {"f": "g"}


def test_a_library_that_changed_on_disk_is_read_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "libmujoco.so"
    monkeypatch.setattr(code_comparison.shared_library, "read", lambda file: file.read_text())
    file.write_text("first")
    assert [code_comparison._read(file), code_comparison._read(file)] == ["first", "first"]
    replacement = tmp_path / "new"
    replacement.write_text("second")
    replacement.replace(file)
    assert code_comparison._read(file) == "second"  # type: ignore[comparison-overlap]
