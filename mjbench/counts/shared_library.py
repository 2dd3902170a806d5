"""Read the functions of a shared library: where each lies, its code, and what its code refers to.

ELF files for x86-64 with a symbol table only: those of MuJoCo's wheels for Linux. Needs pyelftools.
"""

import bisect
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from elftools.common.exceptions import ELFError
from elftools.elf.constants import SH_FLAGS
from elftools.elf.elffile import ELFFile
from elftools.elf.relocation import RelocationSection
from elftools.elf.sections import Section as ElfSection
from elftools.elf.sections import SymbolTableSection

from mjbench.counts import machine_code
from mjbench.counts.callgrind import source_name
from mjbench.counts.machine_code import Instruction, Surroundings
from mjbench.errors import MachineError, describe

# Sections of stubs, by which code calls functions of other libraries: 16 bytes each, `jmp [slot]`.
_STUB_SECTIONS = (".plt", ".plt.sec")
_STUB_BYTES = 16
_JUMP_THROUGH_SLOT = b"\xff\x25"


@dataclass(frozen=True, order=True)
class Symbol:
    """A function in a symbol table, by its mangled name."""

    name: str
    address: int
    size_bytes: int

    @property
    def end(self) -> int:
        return self.address + self.size_bytes


@dataclass(frozen=True)
class Section:
    """Bytes of a file that are loaded at an address."""

    address: int
    content: bytes


@dataclass(frozen=True)
class SharedLibrary:
    """The functions of a library.

    Attributes:
      symbols: of all functions, by address; several may stand for one function.
      imported: names of functions of other libraries, by the address that code calls (in `.plt`).
    """

    symbols: Sequence[Symbol]
    code: Sequence[Section]
    constants: Sequence[Section]
    imported: Mapping[int, str]

    def at(self, address: int) -> list[Symbol]:
        """Return the symbols of the function whose code lies at an address; [] without any."""
        last = bisect.bisect_right(self._addresses, address) - 1
        if last < 0 or address >= self.symbols[last].end:
            return []
        first = bisect.bisect_left(self._addresses, self.symbols[last].address)
        return list(self.symbols[first : last + 1])

    def named(self, name: str) -> list[Symbol]:
        """Return the symbols of a function, clones made by the compiler included."""
        return self._by_name.get(name, [])

    def decoded(self, symbol: Symbol) -> list[Instruction]:
        if symbol.address not in self._decoded:
            code = _content(self.code, symbol.address, symbol.size_bytes) or b""
            surroundings = Surroundings(self.name_at, self.constant_at)
            self._decoded[symbol.address] = machine_code.decode(code, symbol.address, surroundings)
        return self._decoded[symbol.address]

    def name_at(self, address: int) -> str | None:
        symbols = self.at(address)
        return source_name(symbols[0].name) if symbols else self.imported.get(address)

    def constant_at(self, address: int, size_bytes: int) -> bytes | None:
        return _content(self.constants, address, size_bytes)

    @cached_property
    def _decoded(self) -> dict[int, list[Instruction]]:
        return {}

    @cached_property
    def _addresses(self) -> list[int]:
        return [symbol.address for symbol in self.symbols]

    @cached_property
    def _by_name(self) -> Mapping[str, list[Symbol]]:
        by_name: dict[str, list[Symbol]] = defaultdict(list)
        for symbol in self.symbols:
            by_name[source_name(symbol.name)].append(symbol)
        return by_name


def _content(sections: Iterable[Section], address: int, size_bytes: int) -> bytes | None:
    for section in sections:
        begin = address - section.address
        if begin >= 0 and begin + size_bytes <= len(section.content):
            return section.content[begin : begin + size_bytes]
    return None


def read(file: Path) -> SharedLibrary:
    """Return the functions of a library; MachineError where it is unfit, or has no symbols."""
    try:
        with file.open("rb") as stream:
            return _read(ELFFile(stream), file)
    except OSError as error:
        raise MachineError(f"cannot read {file}: {error.strerror}") from error
    except (ELFError, LookupError, ValueError) as error:
        raise MachineError(f"cannot read {file}: {describe(error)}") from error


def _read(elf: ELFFile, file: Path) -> SharedLibrary:
    if elf["e_machine"] != "EM_X86_64":
        raise MachineError(f"{file.name} is not for x86-64")
    table = elf.get_section_by_name(".symtab")
    if not isinstance(table, SymbolTableSection):
        raise MachineError(f"{file.name} has no symbol table")
    symbols = sorted(
        (
            Symbol(entry.name, entry["st_value"], entry["st_size"])
            for entry in table.iter_symbols()
            if entry["st_info"]["type"] == "STT_FUNC" and entry["st_size"]
        ),
        key=lambda symbol: (symbol.address, symbol.name),
    )
    sections = list(elf.iter_sections())
    return SharedLibrary(
        symbols,
        code=[_section(s) for s in sections if s["sh_flags"] & SH_FLAGS.SHF_EXECINSTR],
        constants=[_section(s) for s in sections if s.name.startswith(".rodata")],
        imported=_imported(elf),
    )


def _section(section: ElfSection) -> Section:
    return Section(section["sh_addr"], section.data())


def _imported(elf: ELFFile) -> dict[int, str]:
    """Return the names of imported functions, by the address of the stub that jumps to each.

    A stub reads the function's address from a slot, which the loader fills in by a relocation
    (System V ABI, AMD64 supplement, "Procedure Linkage Table").
    """
    relocations = elf.get_section_by_name(".rela.plt")
    if not isinstance(relocations, RelocationSection):
        return {}
    names = elf.get_section(relocations["sh_link"])
    if not isinstance(names, SymbolTableSection):
        return {}
    by_slot = {
        entry["r_offset"]: names.get_symbol(entry["r_info_sym"]).name
        for entry in relocations.iter_relocations()
    }
    stubs = {}
    for section in elf.iter_sections():
        if section.name in _STUB_SECTIONS:
            for address, slot in _stubs(_section(section)):
                if slot in by_slot:
                    stubs[address] = by_slot[slot]
    return stubs


def _stubs(section: Section) -> Iterator[tuple[int, int]]:
    """Yield the address of each stub, and of the slot that it jumps through."""
    for offset in range(0, len(section.content), _STUB_BYTES):
        stub = section.content[offset : offset + _STUB_BYTES]
        begin, code, distance = stub.partition(_JUMP_THROUGH_SLOT)
        if code and len(distance) >= 4:
            address = section.address + offset
            behind = address + len(begin) + len(code) + 4
            yield address, behind + int.from_bytes(distance[:4], "little", signed=True)
