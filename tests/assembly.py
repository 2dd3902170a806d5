"""Hand-assembled functions for x86-64, and libraries that hold them."""

from collections.abc import Mapping

from mjbench.counts.shared_library import Section, SharedLibrary, Symbol

LOAD_FIELD = bytes.fromhex("488b4710")  # mov rax, [rdi + 0x10]
LOAD_FAR_FIELD = bytes.fromhex("488b8710020000")  # mov rax, [rdi + 0x210]
COPY = bytes.fromhex("4889fe")  # mov rsi, rdi
ADD = bytes.fromhex("4801d1")  # add rcx, rdx
SUBTRACT = bytes.fromhex("4829d1")  # sub rcx, rdx
ROOT = bytes.fromhex("c5f351c9")  # vsqrtsd xmm1, xmm1, xmm1
RETURN = bytes.fromhex("c3")
NOP = bytes.fromhex("90")
PADDING = bytes.fromhex("2e660f1f0400")  # nop word ptr cs:[rax + rax]


def jump_if_zero(distance: int) -> bytes:
    """Return `je` over as many bytes."""
    return b"\x74" + distance.to_bytes(1, "little", signed=True)


def far_jump_if_zero(distance: int) -> bytes:
    """Return a longer encoding of the same."""
    return b"\x0f\x84" + distance.to_bytes(4, "little", signed=True)


def call(target: int, address: int) -> bytes:
    """Return a `call` that lies at an address."""
    return b"\xe8" + (target - address - 5).to_bytes(4, "little", signed=True)


def load_constant(place: int, address: int) -> bytes:
    """Return `vmovsd xmm0, [place]`, relative to the address at which it lies."""
    return b"\xc5\xfb\x10\x05" + (place - address - 8).to_bytes(4, "little", signed=True)


def pass_fifth(number: int) -> bytes:
    """Return `mov r8d, number`."""
    return b"\x41\xb8" + number.to_bytes(4, "little")


def add_number(number: int) -> bytes:
    """Return `add rax, number`."""
    return b"\x48\x05" + number.to_bytes(4, "little")


def library(functions: Mapping[str, bytes], base: int = 0x1000) -> SharedLibrary:
    """Return a library with functions one after the other, each at a multiple of 16."""
    symbols, code = [], b""
    for name, content in functions.items():
        code = code.ljust(-(-len(code) // 16) * 16, b"\xcc")
        symbols.append(Symbol(name, base + len(code), len(content)))
        code += content
    return SharedLibrary(symbols, [Section(base, code)], [], {})
