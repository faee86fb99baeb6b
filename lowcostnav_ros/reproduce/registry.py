"""One registry of results: each entry states what was printed where, with which tolerance, and how to compute it again.

A module in the folder of its study decorates plain functions; the tolerance stands in the decorator, and one that was changed after a run
says so there::

    @result("GR10", "Angle random walk", source="Figure 4.2", thesis="0.194 deg ...", tolerance="5 %")
    def angle_random_walk(context: Context) -> Outcome:
        ...
        return judged("0.195 deg", abs(ours / 0.194 - 1.0) < 0.05, "why it differs, in one sentence", figure=draw)
"""

import importlib
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial, update_wrapper
from pathlib import Path
from typing import Any

import numpy as np

from lowcostnav_ros.base.seeds import stream
from lowcostnav_ros.base.settings import nearest

STUDIES = {
    "gebre": "D. Gebre-Egziabher, Design and Performance Analysis of a Low-Cost Aided Dead Reckoning Navigator, PhD, Stanford, 2004",
    "solimeno": "A. Solimeno, Low-Cost INS/GPS Data Fusion with Extended Kalman Filter for Airborne Applications, MSc, IST Lisbon, 2007",
    "eggers": "J. W. Eggers, Development of a GPS-Aided Navigation System without INS for the USAF A-10 Aircraft, SM, MIT, 1995",
    "kawecki": "J. E. C. Kawecki, Initial Implementation and Testing of a Tightly-Coupled IMU/Pseudolite System, MSc, AFIT, 2015",
    "njenga": "C. N. Njenga, Implementation of a Low-Cost MEMS Inertial Navigation Solution, MSc, Embry-Riddle, 2008",
}
"""What each study is, for headings."""

REPRODUCED = "reproduced"
BETTER = "better than the thesis"
FITTED = "fitted"
DIFFERS = "differs"
BY_DEFINITION = "by definition"
NOT_IN_NUMBERS = "not in numbers"
CRASHED = "crashed"
VERDICTS = {
    REPRODUCED: "within the tolerance, and free to fail it",
    BETTER: "a one-sided bound, passed with a margin that the thesis did not have",
    FITTED: "the number served to choose a setting; the setting and the number without it are named",
    DIFFERS: "outside the tolerance under every reading, the closest is named",
    BY_DEFINITION: "arithmetic on printed inputs, or the rank of nothing: no evidence for a model",
    NOT_IN_NUMBERS: "the thesis claims it without a number",
    CRASHED: "the computation failed",
}
"""Each verdict and what it means."""

DrawFunction = Callable[[Any], None]
"""Draws on the matplotlib figure it is given; the library is loaded only where a figure is saved."""


class ReproduceError(ValueError):
    """A request that cannot be served; the message is one sentence that says what to do."""


@dataclass(frozen=True)
class Reading:
    """One way to read the text where it allows several.

    Attributes
    ----------
    name : str
        What is read, in words: ``correlation distance 5 miles (Table 6.1)``.
    ours : str
        Our numbers under it.
    within : bool
        Whether they are within the tolerance.
    """

    name: str
    ours: str
    within: bool


@dataclass(frozen=True)
class Change:
    """A criterion or a procedure that was changed after a run had shown the result: the date, the verdict until then, what changed."""

    date: str
    before: str
    what: str


@dataclass(frozen=True)
class Outcome:
    """What a result function returns.

    Attributes
    ----------
    ours : str
        Our numbers with their units, as a reader compares them with the thesis.
    verdict : str
        One of :data:`VERDICTS`; all but ``reproduced`` need a reason.
    reason : str
        One sentence; empty where there is nothing to explain.
    figure : callable, optional
        Draws the result on the matplotlib figure it is given; called only when figures are wanted.
    readings : tuple of Reading
        Columns of the result, where the text can be read in several ways.
    """

    ours: str
    verdict: str
    reason: str = ""
    figure: DrawFunction | None = None
    readings: tuple[Reading, ...] = ()

    def __post_init__(self) -> None:
        if self.verdict not in VERDICTS:
            raise ReproduceError(f"A verdict must be one of {', '.join(VERDICTS)}; got '{self.verdict}'.")
        if self.verdict != REPRODUCED and not self.reason:
            raise ReproduceError(f"The verdict '{self.verdict}' needs a reason; give it in one sentence.")


def judged(ours: str, within: bool, reason: str = "", figure: DrawFunction | None = None) -> Outcome:
    """Return the outcome of a comparison: reproduced when ``within`` the tolerance, else differs for ``reason``."""
    why = reason or "outside the tolerance, and the cause is not known"
    return Outcome(ours, REPRODUCED, "", figure) if within else Outcome(ours, DIFFERS, why, figure)


def better(ours: str, within: bool, margin: str, reason: str, figure: DrawFunction | None = None) -> Outcome:
    """Return the outcome of a one-sided bound: better than the thesis by ``margin`` when ``within`` it, else differs for ``reason``."""
    return Outcome(ours, BETTER, margin, figure) if within else Outcome(ours, DIFFERS, reason, figure)


def by_definition(ours: str, within: bool, reason: str, figure: DrawFunction | None = None) -> Outcome:
    """Return the outcome of arithmetic on printed inputs: by definition, or differs where even that does not come out."""
    return Outcome(ours, BY_DEFINITION if within else DIFFERS, reason, figure)


def fitted_by(setting: str, untuned: str) -> str:
    """What a number served to choose, and what it is without that choice, in words."""
    return f"fitted by {setting}; untuned: {untuned}"


def fitted(ours: str, within: bool, setting: str, untuned: str, reason: str = "", figure: DrawFunction | None = None) -> Outcome:
    """Return the outcome of a comparison whose number served to choose ``setting``; ``untuned`` is ours without that choice."""
    if within:
        return Outcome(ours, FITTED, fitted_by(setting, untuned), figure)
    return Outcome(ours, DIFFERS, f"{reason or 'not even when fitted'}; {fitted_by(setting, untuned)}", figure)


def read(readings: Sequence[Reading], reason: str = "", figure: DrawFunction | None = None, verdict: str = REPRODUCED) -> Outcome:
    """Return the outcome of several readings: ``verdict`` when one is within the tolerance, which the thesis must have used."""
    within = [reading for reading in readings if reading.within]
    ours = "; ".join(f"{reading.name}: {reading.ours}" for reading in readings)
    if not within:
        return Outcome(ours, DIFFERS, reason or "under no reading of the text", figure, tuple(readings))
    why = "under every reading" if len(within) == len(readings) else f"as the thesis must have read it: {within[0].name}"
    return Outcome(ours, verdict, f"{why}; {reason}" if reason else why, figure, tuple(readings))


@dataclass
class Context:
    """What a result function may use.

    Attributes
    ----------
    quick : bool
        True asks for fewer runs: about a second per result, the same verdict wherever chance allows.
    seed : int
        Seed of everything random; use :meth:`rng`.
    flown : int
        Seeds flown by the result that is being computed; 0 where it draws all from one stream.
    run : callable
        ``run(function, cases) -> list``: apply a module-level function to picklable cases on all workers, results in the order of
        the cases whatever the number of workers.
    """

    quick: bool = False
    seed: int = 1
    run: Callable[[Callable[[Any], Any], Sequence[Any]], list] = lambda function, cases: [function(case) for case in cases]
    flown: int = 0
    _kept: dict[str, Any] = field(default_factory=dict, repr=False)

    def rng(self, name: str) -> np.random.Generator:
        """Return the random generator of one named purpose, independent of all others."""
        return stream(self.seed, f"reproduce.{name}")

    def seeds(self, name: str, count: int) -> list[int]:
        """Return ``count`` seeds for the cases of a campaign."""
        self.flown = max(self.flown, count)
        return [int(s) for s in self.rng(name).integers(0, 2**62, count)]

    def besides(self, compute: Callable[[], str]) -> str:
        """What stands beside a result and is not judged, in words; a quick run leaves it out."""
        return "not flown in a quick run" if self.quick else compute()

    def once(self, name: str, compute: Callable[[], Any]) -> Any:
        """Compute something that several results share, once in a run."""
        if name not in self._kept:
            before, self.flown = self.flown, 0
            self._kept[name] = compute(), self.flown
            self.flown = before
        value, flown = self._kept[name]
        self.flown = max(self.flown, flown)
        return value


@dataclass(frozen=True)
class Entry:
    """One registered result."""

    id: str
    title: str
    source: str
    thesis: str
    tolerance: str
    study: str
    function: Callable[[Context], Outcome]
    changed: Change | None = None


_ENTRIES: dict[str, Entry] = {}


ResultFunction = Callable[..., Outcome]


def result(
    id: str, title: str, *, source: str, thesis: str, tolerance: str, changed: Change | None = None, **given: Any
) -> Callable[[ResultFunction], ResultFunction]:
    """Register a function as a result; where one function computes several, each has a decorator of its own.

    Parameters
    ----------
    id : str
        Letters and a number, unique (``GR12``).
    title : str
        What is computed.
    source : str
        Figure, table, equation or page.
    thesis : str
        The printed number or claim; a number the thesis does not print itself is marked as recomputed from its model.
    tolerance : str
        What counts as reproduced.
    changed : Change, optional
        What of the criterion or the procedure was changed after a run had shown the result.
    **given
        What the function takes beside the context.
    """

    def register(function: ResultFunction) -> ResultFunction:
        """Enter the function; it stays what it was."""
        study = function.__module__.split(".")[-2] if "." in function.__module__ else function.__module__.partition("_")[0]
        known = _ENTRIES.get(id)
        if known is not None and known.function.__qualname__ != function.__qualname__:
            raise ReproduceError(f"Result {id} is registered twice; give '{title}' an id of its own.")
        _ENTRIES[id] = Entry(id, title, source, thesis, tolerance, study, update_wrapper(partial(function, **given), function), changed)
        return function

    return register


def all_results() -> list[Entry]:
    """Import every result module and list the entries, by letters then by number."""
    for file in Path(__file__).parent.glob("*/*.py"):
        if "\n@result(" in file.read_text(encoding="utf-8"):
            importlib.import_module(f"{__package__}.{file.parent.name}.{file.stem}")
    return sorted(_ENTRIES.values(), key=lambda entry: _natural(entry.id))


def selected(names: Sequence[str], entries: Sequence[Entry] | None = None) -> list[Entry]:
    """Pick results by study or id, case ignored; all where ``names`` is empty.

    Raises
    ------
    ReproduceError
        For a name that is neither, with the nearest that exists.
    """
    entries = all_results() if entries is None else entries
    chosen: set[str] = set()
    studies = {entry.study for entry in entries}
    by_id = {entry.id.upper(): entry.id for entry in entries}
    for name in names:
        if name.lower() in studies:
            chosen |= {entry.id for entry in entries if entry.study == name.lower()}
        elif name.upper() in by_id:
            chosen.add(by_id[name.upper()])
        else:
            raise ReproduceError(f"There is no result or study '{name}'{nearest(name, [*studies, *by_id.values()])}.")
    return [entry for entry in entries if not names or entry.id in chosen]


def _natural(text: str) -> tuple[str, int, str]:
    head, digits, tail = re.findall(r"^([^0-9]*)([0-9]*)(.*)", text)[0]
    return head, int(digits or 0), tail
