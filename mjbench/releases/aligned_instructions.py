"""Find the instructions that need aligned data, and those of equal length that do not.

A library that is moved by 16 or 48 bytes loses the alignment of its data to 32 bytes.

Source: the Intel manual, volume 2 (the encoding of VEX instructions).
"""

from collections.abc import Iterator, Sequence

from mjbench.releases.moved_install import ImmovableError

# The second byte of an instruction that needs an aligned address, and of its twin that does not:
# vmovaps and vmovapd (load, store), and vmovntps and vmovntpd, whose twin stores through the cache.
_TWINS = {0x28: 0x10, 0x29: 0x11, 0x2B: 0x11}
# vmovdqa (load, store) and vmovntdq: their twin vmovdqu has another prefix, and may have another
# opcode.
_INTEGER_TWINS = {0x6F: 0x6F, 0x7F: 0x7F, 0xE7: 0x7F}


def replacements(content: bytes, sections: Sequence[tuple[int, int]]) -> Iterator[tuple[int, int]]:
    """Yield the bytes to replace so that no instruction needs an address aligned to 32 bytes.

    Args:
      sections: that hold code: where each begins and ends in the file.

    Returns:
      Pairs: a place in the file, and the byte that comes there.

    Raises:
      ImmovableError: an instruction needs aligned data and cannot be replaced, bytes are no
        instruction, or capstone is not installed.
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
    """Yield the bytes to replace in a VEX instruction, so that it works at any address."""
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
