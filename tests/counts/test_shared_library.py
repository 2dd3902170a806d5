"""Functions of a shared library: the installed MuJoCo's, and what is none."""

from pathlib import Path

import mujoco
import pytest

from mjbench.counts import shared_library
from mjbench.counts.shared_library import SharedLibrary
from mjbench.errors import MachineError

FILES = sorted(Path(mujoco.__file__).parent.glob("libmujoco.so.*"))
needs_mujoco_of_linux = pytest.mark.skipif(not FILES, reason="this MuJoCo is not an ELF file")


@pytest.fixture(scope="module")
def engine() -> SharedLibrary:
    return shared_library.read(FILES[0])


@needs_mujoco_of_linux
def test_a_function_is_found_by_its_name_and_by_each_of_its_addresses(
    engine: SharedLibrary,
) -> None:
    (step,) = engine.named("mj_step")
    assert engine.at(step.address) == engine.at(step.end - 1) == [step]
    assert step not in engine.at(step.end)
    assert engine.at(0) == []


@needs_mujoco_of_linux
def test_calls_are_known_by_the_names_of_callees(engine: SharedLibrary) -> None:
    (step,) = engine.named("mj_step")
    assert "mj_checkVel" in {instruction.callee for instruction in engine.decoded(step)}
    stubs = set(engine.imported.values())
    assert {"memcpy", "abort"} <= stubs
    assert all(engine.name_at(address) for address in engine.imported)


@needs_mujoco_of_linux
def test_constants_are_of_sections_that_do_not_change(engine: SharedLibrary) -> None:
    section = engine.constants[0]
    end = section.address + len(section.content)
    assert engine.constant_at(section.address, 8) == section.content[:8]
    assert engine.constant_at(end - 4, 8) is None


def test_a_file_that_is_no_library_with_symbols_says_so(tmp_path: Path) -> None:
    with pytest.raises(MachineError, match="No such file"):
        shared_library.read(tmp_path / "missing.so")
    text = tmp_path / "text.so"
    text.write_text("not ELF")
    with pytest.raises(MachineError, match=r"cannot read .*text\.so"):
        shared_library.read(text)


@needs_mujoco_of_linux
def test_a_stripped_library_says_that_it_has_no_symbols() -> None:
    stripped = next(Path(mujoco.__file__).parent.glob("_functions.*.so"))
    with pytest.raises(MachineError, match="no symbol table"):
        shared_library.read(stripped)


@needs_mujoco_of_linux
def test_a_library_that_was_cut_short_cannot_be_read(tmp_path: Path) -> None:
    short = tmp_path / "short.so"
    short.write_bytes(FILES[0].read_bytes()[:100_000])
    with pytest.raises(MachineError, match="cannot read"):
        shared_library.read(short)
