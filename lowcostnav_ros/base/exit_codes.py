"""Exit statuses of every command, node and graph of the package."""

from enum import IntEnum


class Exit(IntEnum):
    """0 pass; 1 worse than the baseline or a failed check; 2 cannot run, with one sentence on stderr; 130 interrupted."""

    OK = 0
    WORSE = 1
    CANNOT_RUN = 2
    INTERRUPTED = 130
