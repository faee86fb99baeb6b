"""Jobs of the command line: each is described in the module of its name, options and work together, and found through a registry.

Only the module of the job that is asked for is imported; what the others do is read in their files, so that ``lowcostnav --help`` answers
at once.
"""

import argparse
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from lowcostnav_ros.base.registry import Registry

_CALIBRATION = ("calibrate_charts", "calibrate_input", "calibrate_reference", "calibrate_rest", "calibrate_swing")
HELPERS = (*_CALIBRATION, "jobs", "main", "options", "progress")
"""Modules of this package that are no jobs."""


@dataclass(frozen=True)
class Job:
    """One word of the command line: what it does, its options, and the function that does it and returns the exit status."""

    text: str
    add_arguments: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], int]
    epilog: str = ""


JOBS: Registry[Job] = Registry("job", "lowcostnav_ros.cli", HELPERS)


def summary(name: str) -> str:
    """What a job does, in a sentence, without importing a module of this package for it."""
    file = Path(__file__).with_name(f"{name}.py")
    written = re.search(r'^@job\(\s*"([^"]+)"', file.read_text(encoding="utf-8"), re.MULTILINE) if file.is_file() else None
    return written[1] if written else JOBS[name].text


def job(
    text: str, add_arguments: Callable[[argparse.ArgumentParser], None] = lambda _: None, epilog: str = ""
) -> Callable[[Callable[[argparse.Namespace], int]], Callable[[argparse.Namespace], int]]:
    """Enter a function as the job of its name.

    Parameters
    ----------
    text : str
        What it does, in a sentence.
    add_arguments : callable
        Adds its options to a parser.
    epilog : str
        Shown below the options.
    """

    def decorator(run: Callable[[argparse.Namespace], int]) -> Callable[[argparse.Namespace], int]:
        JOBS.register(run.__name__, Job(text, add_arguments, run, epilog), run.__module__)
        return run

    return decorator
