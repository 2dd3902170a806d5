"""Switch Callgrind's instrumentation on and off from inside the program that it runs.

Without it, Callgrind runs a program several times faster, and counts nothing. A program asks for
the change by instructions that do nothing outside Valgrind (`VALGRIND_DO_CLIENT_REQUEST` of
valgrind.h, and callgrind.h).
"""

import ctypes
import mmap
import platform
import sys

# Of callgrind.h: the base of its requests, and their numbers.
_BASE = ord("C") << 24 | ord("T") << 16
_START, _STOP = _BASE + 4, _BASE + 5
# A function of the address of a request: six numbers of 64 bits, the request first.
_X86_64 = bytes.fromhex(
    "4889f8"  # mov rax, rdi
    "31d2"  # xor edx, edx
    "48c1c703 48c1c70d 48c1c73d 48c1c733"  # rol rdi by 3, 13, 61 and 51: together, nothing
    "4887db"  # xchg rbx, rbx
    "4889d0"  # mov rax, rdx
    "c3"  # ret
)


def can_switch() -> bool:
    """Return whether a program can ask for the change on this machine's kind of processor."""
    return sys.platform == "linux" and platform.machine() == "x86_64"


class Instrumentation:
    """Callgrind's instrumentation of this process, off at first where it can be switched."""

    def __init__(self) -> None:
        self._request = None
        if can_switch():
            self._code = mmap.mmap(
                -1, len(_X86_64), prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC
            )
            self._code.write(_X86_64)
            address = ctypes.addressof(ctypes.c_char.from_buffer(self._code))
            self._request = ctypes.CFUNCTYPE(ctypes.c_uint64, ctypes.c_void_p)(address)

    def start(self) -> None:
        """Count from here on."""
        self._ask(_START)

    def stop(self) -> None:
        """Count no more."""
        self._ask(_STOP)

    def _ask(self, request: int) -> None:
        if self._request is not None:
            arguments = (ctypes.c_uint64 * 6)(request)
            self._request(ctypes.addressof(arguments))
