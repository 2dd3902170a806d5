"""A file that is mapped into memory: what is written survives any end of the program."""

import mmap
import os


def map_file(path: str, size: int) -> mmap.mmap:
    """Return the memory of a new file, filled with zeros.

    Raises:
      OSError: the file cannot be created, or the disk is full.
    """
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC, 0o600)
    try:
        os.ftruncate(descriptor, size)
        if hasattr(os, "posix_fallocate"):
            # writing to a file without space would end the program
            os.posix_fallocate(descriptor, 0, size)
        return mmap.mmap(descriptor, 0)
    finally:
        os.close(descriptor)
