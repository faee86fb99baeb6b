"""Jobs of the command line: each is described in the module of its name, options and work together, and found through a registry.

A module of a job imports what it works with when it works, so that ``lowcostnav --help`` answers at once.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass

from lowcostnav_ros.base.registry import Registry

HELPERS = ("calibrate_charts", "calibrate_input", "calibrate_rest", "jobs", "main", "options", "progress")
"""Modules of this package that are no jobs."""


@dataclass(frozen=True)
class Job:
    """One word of the command line: what it does, its options, and the function that does it and returns the exit status."""

    text: str
    add_arguments: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], int]
    epilog: str = ""


JOBS: Registry[Job] = Registry("job", "lowcostnav_ros.cli", HELPERS)


def job(
    text: str, add_arguments: Callable[[argparse.ArgumentParser], None] = lambda _: None, epilog: str = ""
) -> Callable[[Callable[[argparse.Namespace], int]], Callable[[argparse.Namespace], int]]:
    """Enter a function as the job of its name.

    Parameters
    ----------
    text : str
        What it does, in a sentence.
    add_arguments : callable
        Adds its options to a parser; must import nothing heavy.
    epilog : str
        Shown below the options.
    """

    def decorator(run: Callable[[argparse.Namespace], int]) -> Callable[[argparse.Namespace], int]:
        JOBS.register(run.__name__, Job(text, add_arguments, run, epilog), run.__module__)
        return run

    return decorator
