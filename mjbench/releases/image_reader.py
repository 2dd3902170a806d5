"""Read what has to change in a shared library when its image is moved (see `moved_install`).

Sources: the System V ABI, generic and AMD64 supplement (headers, dynamic tags, relocations); the
Intel manual, volume 2 (the encoding of VEX instructions).
"""

import functools
import io
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from mjbench.errors import describe
from mjbench.releases.moved_install import ImmovableError, MovableImage
from mjbench.releases.placement import PAGE_BYTES

# Tags of the dynamic section whose value is an address.
_ADDRESS_TAGS = {
    *("DT_PLTGOT", "DT_HASH", "DT_STRTAB", "DT_SYMTAB", "DT_RELA", "DT_JMPREL", "DT_INIT"),
    *("DT_FINI", "DT_INIT_ARRAY", "DT_FINI_ARRAY", "DT_PREINIT_ARRAY", "DT_GNU_HASH"),
    *("DT_VERSYM", "DT_VERNEED", "DT_VERDEF", "DT_TLSDESC_PLT", "DT_TLSDESC_GOT"),
}
# Tags whose value is not.
_OTHER_TAGS = {
    *("DT_NULL", "DT_NEEDED", "DT_SONAME", "DT_RPATH", "DT_RUNPATH", "DT_FLAGS", "DT_FLAGS_1"),
    *("DT_RELASZ", "DT_RELAENT", "DT_RELACOUNT", "DT_PLTRELSZ", "DT_PLTREL", "DT_SYMENT"),
    *("DT_STRSZ", "DT_INIT_ARRAYSZ", "DT_FINI_ARRAYSZ", "DT_PREINIT_ARRAYSZ"),
    *("DT_VERNEEDNUM", "DT_VERDEFNUM", "DT_BIND_NOW", "DT_SYMBOLIC", "DT_DEBUG"),
}
# Relocations whose addend is an address (RELATIVE, IRELATIVE), and those for which moving their
# place is enough: 64, GLOB_DAT, JUMP_SLOT, DTPMOD64, DTPOFF64, TPOFF64.
_ADDEND_IS_ADDRESS = (8, 37)
_OTHER_RELOCATIONS = (1, 6, 7, 16, 17, 18)
_JUMP_SLOT = 7
_SYMBOL = np.dtype(
    [("name", "<u4"), ("info", "u1"), ("other", "u1"), ("shndx", "<u2"), ("value", "<u8"),
     ("size", "<u8")]
)  # fmt: skip
_RELOCATION = np.dtype([("offset", "<u8"), ("info", "<u8"), ("addend", "<i8")])
_UNDEFINED, _ABSOLUTE, _TLS = 0, 0xFFF1, 6
# Flags of sections: SHF_ALLOC, SHF_EXECINSTR, SHF_TLS.
_ALLOCATED, _EXECUTABLE, _THREAD_LOCAL = 0x2, 0x4, 0x400
# The second byte of an instruction that needs an aligned address, and of its twin that does not:
# vmovaps and vmovapd (load, store), and vmovntps and vmovntpd, whose twin stores through the cache.
_TWINS = {0x28: 0x10, 0x29: 0x11, 0x2B: 0x11}
# vmovdqa (load, store) and vmovntdq: their twin vmovdqu has another prefix, and may have another
# opcode.
_INTEGER_TWINS = {0x6F: 0x6F, 0x7F: 0x7F, 0xE7: 0x7F}


def read(content: bytes) -> MovableImage:
    """Return what has to change in a library when it is moved; ImmovableError if it cannot be."""
    try:
        from elftools.elf.elffile import ELFFile
    except ImportError as error:
        raise ImmovableError("pyelftools is not installed") from error
    try:
        reader = _Reader(content, ELFFile(io.BytesIO(content)))
        reader.check()
        addresses = np.unique(np.concatenate([*reader.addresses()]))
        if np.any(addresses % 8):
            raise ImmovableError("it holds an address that is not aligned")
        return MovableImage(
            reader.headers_end,
            addresses,
            _replacements(reader.permissions()),
            _replacements(unaligned_twins(content, reader.code())),
        )
    except ImmovableError:
        raise
    except Exception as error:  # damaged bytes raise whatever they spell
        raise ImmovableError(f"it is no shared library for Linux ({describe(error)})") from error


def _replacements(places_and_bytes: Iterable[tuple[int, int]]) -> np.ndarray:
    """Return (n, 2) places in the file, and the byte that each is to hold."""
    return np.array([*places_and_bytes], np.int64).reshape(-1, 2)


class _Reader:
    def __init__(self, content: bytes, elf: Any):
        self._content, self._elf = content, elf
        header = elf.header
        self._segments = [segment.header for segment in elf.iter_segments()]
        self.headers_end = header.e_phoff + header.e_phnum * header.e_phentsize

    def check(self) -> None:
        header = self._elf.header
        if header.e_machine != "EM_X86_64" or header.e_type != "ET_DYN":
            raise ImmovableError("it is not a shared library for x86-64")
        first = self._loads[0]
        if first.p_offset or first.p_vaddr or first.p_filesz != first.p_memsz:
            raise ImmovableError("its first segment does not begin with its headers")
        if any(segment.p_type == "PT_INTERP" for segment in self._segments):
            raise ImmovableError("it is a program")
        if not any(section["sh_flags"] & _EXECUTABLE for section in self._elf.iter_sections()):
            raise ImmovableError("no section header says where its code is")
        if header.e_phoff != header.e_ehsize or any(
            0 < section["sh_offset"] < self.headers_end and section["sh_size"]
            for section in self._elf.iter_sections()
        ):
            raise ImmovableError("its program headers are not at its beginning")

    def permissions(self) -> Iterator[tuple[int, int]]:
        """Yield the bytes of program headers to replace, so that segments can share a page.

        Where two do, the later one decides what its content may be used for. Bit by bit that must
        be what either needs: code of the one could not be executed otherwise.
        """
        flags = self._loads[0].p_flags
        for before, after in zip(self._loads, self._loads[1:], strict=False):
            # a page at least from the last byte of the one to the first byte of the other
            if after.p_vaddr - self._end(before) + 1 >= PAGE_BYTES:
                flags = after.p_flags
                continue
            if (
                after.p_vaddr - after.p_offset != before.p_vaddr - before.p_offset
                or before.p_filesz != before.p_memsz
            ):
                raise ImmovableError("two of its segments lie too close to each other")
            flags |= after.p_flags
            if flags != after.p_flags:
                yield self._place(after) + 4, flags
                yield from self._left_writable(after)

    def _left_writable(self, load: Any) -> Iterator[tuple[int, int]]:
        """Yield the bytes to replace, so that the beginning of a segment keeps its permissions.

        The loader makes what was relocated read-only, page by page (PT_GNU_RELRO). On the page that
        `load` shares, it would take the permission to execute from the code before it. A header of
        type PT_NULL is ignored.
        """
        for segment in self._segments:
            if segment.p_type == "PT_GNU_RELRO" and segment.p_vaddr == load.p_vaddr:
                place = self._place(segment)
                yield from ((place + i, 0) for i in range(4))

    def _place(self, segment: Any) -> int:
        header = self._elf.header
        index = next(i for i, other in enumerate(self._segments) if other is segment)
        return int(header.e_phoff + index * header.e_phentsize)

    def _end(self, segment: Any) -> int:
        """Return where the last section of a segment ends that is not padding."""
        begin, end = segment.p_vaddr, segment.p_vaddr + segment.p_memsz
        ends = [
            section["sh_addr"] + section["sh_size"]
            for section in self._elf.iter_sections()
            if section["sh_flags"] & _ALLOCATED
            and not (section["sh_flags"] & _THREAD_LOCAL and section["sh_type"] == "SHT_NOBITS")
            and begin <= section["sh_addr"] < end
            and section.name != ".relro_padding"
        ]
        return int(max(ends, default=end))

    @functools.cached_property
    def _loads(self) -> list[Any]:
        loads = [segment for segment in self._segments if segment.p_type == "PT_LOAD"]
        if not loads:
            raise ImmovableError("it has no segments")
        return loads

    def code(self) -> list[tuple[int, int]]:
        """Return where each section of code begins and ends in the file."""
        return [
            (section["sh_offset"], section["sh_offset"] + section["sh_size"])
            for section in self._elf.iter_sections()
            if section["sh_flags"] & _EXECUTABLE
        ]

    def addresses(self) -> Iterator[np.ndarray]:
        """Yield places in the file of 8-byte numbers that grow by the shift."""
        yield np.array(list(self._in_headers()), dtype=np.int64)
        yield self._in_dynamic_section()
        for name in (".dynsym", ".symtab"):
            yield self._in_symbols(self._elf.get_section_by_name(name))
        for tag, size in (("DT_RELA", "DT_RELASZ"), ("DT_JMPREL", "DT_PLTRELSZ")):
            if tag in self._dynamic:
                yield from self._in_relocations(self._dynamic[tag], self._dynamic[size])

    def _in_headers(self) -> Iterator[int]:
        header = self._elf.header
        if header.e_shoff:
            yield 40  # e_shoff
        for segment in self._segments:
            place = self._place(segment)
            if segment is self._loads[0]:  # begins with the headers, which stay
                yield from (place + 32, place + 40)  # p_filesz, p_memsz
            elif segment.p_type not in ("PT_PHDR", "PT_GNU_STACK"):
                yield from (place + 8, place + 16, place + 24)  # p_offset, p_vaddr, p_paddr
        for i, section in enumerate(self._elf.iter_sections()):
            place = header.e_shoff + i * header.e_shentsize
            if section["sh_addr"]:
                yield place + 16
            if section["sh_offset"] >= self.headers_end:
                yield place + 24

    @functools.cached_property
    def _dynamic(self) -> dict[str, int]:
        return {str(tag.entry.d_tag): int(tag.entry.d_val) for tag in self._dynamic_tags()}

    def _dynamic_tags(self) -> Iterator[Any]:
        for segment in self._elf.iter_segments():
            if segment.header.p_type == "PT_DYNAMIC":
                yield from segment.iter_tags()

    def _in_dynamic_section(self) -> np.ndarray:
        unknown = set(self._dynamic) - _ADDRESS_TAGS - _OTHER_TAGS
        if unknown:
            raise ImmovableError(f"its dynamic section has {_some(unknown)}")
        header = next((s for s in self._segments if s.p_type == "PT_DYNAMIC"), None)
        if header is None:
            raise ImmovableError("it has no dynamic section")
        places = [
            header.p_offset + 16 * i + 8
            for i, tag in enumerate(self._dynamic_tags())
            if tag.entry.d_tag in _ADDRESS_TAGS and tag.entry.d_val
        ]
        # the first entry of the global offset table holds the address of the dynamic section
        if "DT_PLTGOT" in self._dynamic:
            table = self._offset(self._dynamic["DT_PLTGOT"])
            if self._number(table) == header.p_vaddr:
                places.append(table)
        return np.array(places, dtype=np.int64)

    def _in_symbols(self, section: Any) -> np.ndarray:
        if section is None:
            return np.empty(0, np.int64)
        begin, size = section["sh_offset"], section["sh_size"]
        symbols = np.frombuffer(self._content, _SYMBOL, size // _SYMBOL.itemsize, begin)
        index = symbols["shndx"]
        moves = (index != _UNDEFINED) & (index != _ABSOLUTE) & (symbols["info"] & 15 != _TLS)
        return np.asarray(begin + np.flatnonzero(moves) * _SYMBOL.itemsize + 8)

    def _in_relocations(self, address: int, size: int) -> Iterator[np.ndarray]:
        begin = self._offset(address)
        entries = np.frombuffer(self._content, _RELOCATION, size // _RELOCATION.itemsize, begin)
        kinds = entries["info"] & 0xFFFFFFFF
        unknown = set(kinds.tolist()) - {*_ADDEND_IS_ADDRESS, *_OTHER_RELOCATIONS}
        if unknown:
            raise ImmovableError(f"it has relocations of type {_some(unknown)}")
        places = begin + np.arange(len(entries)) * _RELOCATION.itemsize
        yield places
        yield places[np.isin(kinds, _ADDEND_IS_ADDRESS)] + 16
        slots = [self._offset(int(a)) for a in entries["offset"][kinds == _JUMP_SLOT]]
        yield np.array([slot for slot in slots if self._number(slot)], dtype=np.int64)

    def _offset(self, address: int) -> int:
        for segment in self._loads:
            if segment.p_vaddr <= address < segment.p_vaddr + segment.p_filesz:
                return int(address - segment.p_vaddr + segment.p_offset)
        raise ImmovableError(f"nothing lies at its address {address:#x}")

    def _number(self, place: int) -> int:
        return int.from_bytes(self._content[place : place + 8], "little")


def _some(unknown: Iterable[object]) -> str:
    """Return the first three of what is unknown; a damaged file may have thousands."""
    return ", ".join(sorted(map(str, unknown))[:3])


def unaligned_twins(
    content: bytes, sections: Sequence[tuple[int, int]]
) -> Iterator[tuple[int, int]]:
    """Yield places, and bytes to put there so that no instruction needs data aligned to 32 bytes.

    A library that is moved by 16 or 48 bytes loses this alignment.
    """
    try:
        import capstone
    except ImportError as error:
        raise ImmovableError("capstone is not installed") from error
    decoder = capstone.Cs(capstone.CS_ARCH_X86, capstone.CS_MODE_64)
    decoder.skipdata = True
    for begin, end in sections:
        for place, size, name, operands in decoder.disasm_lite(content[begin:end], begin):
            if name == ".byte":  # what follows it may be decoded from a wrong place
                raise ImmovableError("its code has bytes that are no known instruction")
            if "[" not in operands or not name.startswith(("vmova", "vmovdqa", "vmovnt")):
                continue
            if "zmm" in operands:
                raise ImmovableError("it has instructions that need data aligned to 64 bytes")
            if "ymm" in operands:
                yield from _unaligned(content[place : place + size], place)


def _unaligned(instruction: bytes, place: int) -> Iterator[tuple[int, int]]:
    try:
        # a VEX prefix has two bytes (C5) or three (C4); its last one ends with `pp`
        last = 1 if instruction[0] == 0xC5 else 2
        if instruction[0] not in (0xC4, 0xC5) or (
            instruction[0] == 0xC4 and instruction[1] & 0x1F != 1
        ):
            raise KeyError
        opcode = instruction[last + 1]
        if opcode in _INTEGER_TWINS and instruction[last] & 3 == 1:
            yield place + last, instruction[last] & ~3 | 2
            yield place + last + 1, _INTEGER_TWINS[opcode]
        else:
            yield place + last + 1, _TWINS[opcode]
    except (KeyError, IndexError):
        raise ImmovableError(
            f"the instruction {instruction.hex()} needs aligned data, and has no known twin"
        ) from None
