"""Baselines: what a replay should find, kept under version control, and the verdict better, same or worse.

A baseline file names, per navigator, metrics by their dotted path in the replay's result, each with an expectation::

    bag: 5f0c...                       # identity of the bag; another bag is refused
    navigators:
      dead_reckoning:
        errors.without_gps.horizontal_m.rms: {value: 214.0, tolerance: 5%}
        errors.flight.error_over_sigma.north_m: {value: 0.93, tolerance: 0.2, best: 1.0}
        errors.without_gps.horizontal_m.max: {limit: 600.0}
        fused.equals_recorded: {value: true}

``value`` with ``tolerance`` (a number in the metric's unit, or per cent of the value): within it is *same*; farther from ``best``
(0 unless given) is *worse*, nearer is *better*.  ``limit``: farther from ``best`` than that is *worse*.  A metric that has gone
missing is *worse*.
"""

import dataclasses
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

from lowcostnav_ros.base.documents import read_yaml, write_text
from lowcostnav_ros.base.settings import SettingsError, nearest

BETTER, SAME, WORSE = "better", "same", "worse"
_KEYS = ("value", "tolerance", "limit", "best")
_WRITTEN_SIZES = ("horizontal_m", "vertical_m", "velocity_mps", "roll_deg", "pitch_deg", "heading_deg", "wind_mps")
_RESOLUTION = 0.005
"""Below this, in the metric's unit, a difference does not matter in flight."""
_WRITTEN_RATIOS = ("north_m", "east_m", "down_m", "vn_mps", "ve_mps", "roll_deg", "pitch_deg", "heading_deg")


class BaselineError(ValueError):
    """A baseline that cannot be used; the message is one sentence that says what to do."""


@dataclasses.dataclass(frozen=True, slots=True)
class Expectation:
    """One expected metric: a value with an absolute tolerance, or a limit; ``best`` is the ideal value."""

    navigator: str
    metric: str
    value: float | bool | None = None
    tolerance: float = 0.0
    limit: float | None = None
    best: float = 0.0


@dataclasses.dataclass(frozen=True, slots=True)
class Verdict:
    """One metric judged: found value (None when missing), what was expected in words, and the verdict."""

    navigator: str
    metric: str
    found: float | bool | None
    expected: str
    verdict: str


def load_baseline(path: Path) -> tuple[str | None, list[Expectation]]:
    """Read a baseline file: bag identity (None when it names none) and expectations.

    Raises
    ------
    BaselineError
        When the file is missing, is not YAML of the form above, or holds an unknown key.
    """
    try:
        data = read_yaml(path)
    except SettingsError as error:
        raise BaselineError(f"Baseline: {error} Make one with --write-baseline.") from error
    if not isinstance(data, Mapping) or not isinstance(data.get("navigators"), Mapping):
        raise BaselineError(f"Baseline {path} has no 'navigators' section; make one with --write-baseline.")
    expectations = []
    for navigator, metrics in data["navigators"].items():
        if not isinstance(metrics, Mapping):
            raise BaselineError(f"Baseline {path}: '{navigator}' must hold metrics with expectations.")
        expectations += [_expectation(path, navigator, metric, entry) for metric, entry in metrics.items()]
    bag = data.get("bag")
    if bag is not None and not isinstance(bag, str):
        raise BaselineError(f"Baseline {path}: 'bag' must be the identity of a bag in quotes, got {str(bag)[:40]}.")
    return bag, expectations


def _expectation(path: Path, navigator: str, metric: str, entry: Any) -> Expectation:
    where = f"Baseline {path}: {navigator} {metric}"
    if not isinstance(entry, Mapping) or ("value" in entry) == ("limit" in entry):
        raise BaselineError(f"{where} must hold either 'value' (with 'tolerance') or 'limit'.")
    for key in entry:
        if key not in _KEYS:
            raise BaselineError(f"{where}: unknown key '{key}'{nearest(key, _KEYS)}.")
    value, tolerance = entry.get("value"), entry.get("tolerance", 0.0)
    try:
        if isinstance(tolerance, str) and tolerance.rstrip().endswith("%"):
            tolerance = abs(float(entry["value"])) * float(tolerance.rstrip().rstrip("%")) / 100.0
        limit = None if entry.get("limit") is None else float(entry["limit"])
        value = value if value is None or isinstance(value, bool) else float(value)
        return Expectation(navigator, metric, value, float(tolerance), limit, float(entry.get("best", 0.0)))
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise BaselineError(f"{where}: value, tolerance, limit and best must be numbers (a tolerance may be a percentage).") from error


def judge(expectations: list[Expectation], summary: Mapping[str, Any]) -> list[Verdict]:
    """Compare a replay's summary with what was expected of it."""
    return [_judge(e, lookup(summary, e.navigator, e.metric)) for e in expectations]


def lookup(summary: Mapping[str, Any], navigator: str, metric: str) -> float | bool | None:
    """A metric of a navigator by its dotted path, None when there is none."""
    node: Any = summary["navigators"].get(navigator)
    for part in metric.split("."):
        node = node.get(part) if isinstance(node, Mapping) else None
    return node if isinstance(node, bool | int | float) and math.isfinite(node) else None


def _judge(e: Expectation, found: float | bool | None) -> Verdict:
    number = None if found is None or isinstance(found, bool) else found
    if isinstance(e.value, bool):
        expected, verdict = str(e.value).lower(), SAME if found is e.value else WORSE
    elif e.value is None or e.limit is not None:
        limit = e.limit or 0.0
        expected = f"within {limit:.4g}" + (f" of {e.best:g}" if e.best != 0.0 else "")
        verdict = SAME if number is not None and abs(number - e.best) <= limit else WORSE
    else:
        expected, verdict = f"{e.value:.4g} ± {e.tolerance:.2g}", WORSE
        if number is not None and abs(number - e.value) <= e.tolerance:
            verdict = SAME
        elif number is not None and abs(number - e.best) <= abs(e.value - e.best):
            verdict = BETTER
    return Verdict(e.navigator, e.metric, found, expected, verdict)


def write_baseline(path: Path, summary: Mapping[str, Any], tolerance: str = "5%") -> int:
    """Write a baseline from a replay's summary; return the number of metrics.

    Parameters
    ----------
    path : Path
    summary : mapping
    tolerance : str
        Tolerance of the error sizes; error-over-sigma ratios get 0.1.
    """
    navigators = {name: dict(_metrics(summary, name, tolerance)) for name in summary["navigators"]}
    navigators = {name: metrics for name, metrics in navigators.items() if metrics}
    identity = (summary.get("bag") or {}).get("sha256")
    data = {**({"bag": identity} if identity else {}), "navigators": navigators}
    head = "# Expected results of a replay; change on purpose only.  Tolerance is in the metric's unit or per cent; best is the ideal.\n"
    write_text(path, head + yaml.safe_dump(data, sort_keys=False, default_flow_style=None, width=140))
    return sum(len(m) for m in navigators.values())


def _metrics(summary: Mapping[str, Any], name: str, tolerance: str) -> Iterator[tuple[str, dict]]:
    for part in ("flight", "without_gps", "withheld_gps"):
        for size in _WRITTEN_SIZES:
            for statistic in ("rms", "p95"):
                metric = f"errors.{part}.{size}.{statistic}"
                if (found := lookup(summary, name, metric)) is not None:
                    floor = _RESOLUTION if found < 20.0 * _RESOLUTION else tolerance
                    yield metric, {"value": float(f"{found:.6g}"), "tolerance": floor}
        for axis in _WRITTEN_RATIOS:
            metric = f"errors.{part}.error_over_sigma.{axis}"
            if (found := lookup(summary, name, metric)) is not None:
                yield metric, {"value": float(f"{found:.4g}"), "tolerance": 0.1, "best": 1.0}
    if summary["navigators"][name]["fused"]["equals_recorded"]:
        yield "fused.equals_recorded", {"value": True}
