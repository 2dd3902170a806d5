"""Two fixed pieces of work that show how fast this machine is at the moment.

One computes, the other copies memory: clocks and neighbours of a shared machine slow these down by
different amounts, and any other function, it is assumed, by something in between. They need Python
alone, so that no release of NumPy or MuJoCo changes them.
"""

import hashlib

# Times of other versions of the two cannot be compared.
VERSION = 1
# Each half of the computing takes about a tenth of a millisecond, and the copy about as long as
# both. It is larger than the caches of a core, and than what the allocator keeps.
_TURNS, _HASHES, _BYTES, _COPIED = 600, 2, bytes(range(256)) * 256, bytes(1 << 22)


def compute() -> float:
    """Run some bytecode, and compiled code that hashes; return a number that depends on all."""
    state, values, counts = 1, [], dict.fromkeys(range(256), 0)
    for _ in range(_TURNS):
        state = (state * 1103515245 + 12345) & 0x7FFFFFFF
        counts[state & 255] += 1
        values.append(state * 0.5)
    digest = b""
    for _ in range(_HASHES):
        digest = hashlib.blake2b(_BYTES + digest).digest()
    return sum(values) + counts[digest[0]]


def copy() -> int:
    """Copy some memory to a new place; return its size in bytes."""
    return len(bytearray(_COPIED))
