"""Several results as one, their navigators beside each other under the names of the runs."""

import dataclasses
from collections.abc import Mapping

from lowcostnav_ros.report.flight.result_folder import ReportError, Result


def side_by_side(results: Mapping[str, Result]) -> Result:
    """One result of several, by the name of the run; reference, fixes, outages and the rest are those of the first.

    Raises
    ------
    ReportError
        When two runs have no time in common, which nothing could be compared over.
    """
    first = next(iter(results.values()))
    for run, other in results.items():
        if min(first.summary.last_stamp_s, other.summary.last_stamp_s) <= max(first.summary.first_stamp_s, other.summary.first_stamp_s):
            raise ReportError(f"{run} and {next(iter(results))} have no time in common; compare runs over one recording.")
    flown = {f"{name} ({run})": one for run, result in results.items() for name, one in result.navigators.items()}
    flown = {name: dataclasses.replace(one, name=name) for name, one in flown.items()}
    summed = {f"{name} ({run})": one for run, result in results.items() for name, one in result.summary.navigators.items()}
    settings = {run: result.summary.settings for run, result in results.items()}
    summary = dataclasses.replace(first.summary, navigators=summed, settings=settings, time=None, verdicts=None)
    return dataclasses.replace(first, summary=summary, navigators=flown)
