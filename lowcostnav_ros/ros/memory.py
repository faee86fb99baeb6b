"""Give memory back once a node is ready."""

import ctypes
import gc
import re
import sys

MADV_DONTNEED = 4
_MAPPING = re.compile(r"^([0-9a-f]+)-([0-9a-f]+) r-[x-]p \S+ \S+ \d+ +/\S+\.so\S*\n((?:\w+:.*\n)+)", re.MULTILINE)


def release_idle_code() -> int:
    """Unmap from memory the pages of shared libraries that start-up read and flight does not; return the bytes let go.

    Start-up runs through the whole of a compiler and a middleware: 90 MB of library code per process that a flying node never looks at
    again.  Only clean, read-only pages of library files are let go; one that is needed after all comes back from the file by itself.
    """
    gc.collect()
    if not sys.platform.startswith("linux"):
        return 0
    try:
        libc = ctypes.CDLL(None, use_errno=True)
        libc.madvise.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int]
        with open("/proc/self/smaps", encoding="ascii", errors="replace") as smaps:
            mappings = _MAPPING.findall(smaps.read())
    except (OSError, AttributeError):
        return 0
    released = 0
    for first, last, facts in mappings:
        start, end = int(first, 16), int(last, 16)
        # pages the loader has written to (relocations) are no copy of the file any more: they count as anonymous and must stay
        resident = re.search(r"^Rss: +(\d+) kB$", facts, re.MULTILINE)
        if resident and re.search(r"^Anonymous: +0 kB$", facts, re.MULTILINE) and libc.madvise(start, end - start, MADV_DONTNEED) == 0:
            released += 1024 * int(resident[1])
    return released
