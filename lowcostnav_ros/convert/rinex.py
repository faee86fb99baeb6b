"""RINEX files to a recording with ``gnss/raw``: the epochs a driver would have published, corrected, at their time of validity.

The integrity test decides at which position an epoch is corrected, not which satellites are recorded: a navigator judges them by itself.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import yaml

from lowcostnav_ros.base.measurements import GnssEpoch
from lowcostnav_ros.base.text import counted
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.convert.convert import write_records
from lowcostnav_ros.convert.profile import ConvertError
from lowcostnav_ros.convert.rinex_files import read_navigation, read_observations
from lowcostnav_ros.gnss.track import HOLD_S, Track, track
from lowcostnav_ros.messages import encode, topics
from lowcostnav_ros.messages.bag_writer import SETTINGS_FOLDER, BagWriter, new_bag
from lowcostnav_ros.messages.encode import Record
from lowcostnav_ros.messages.store import to_cdr
from lowcostnav_ros.navigators.gnss_only import GnssOnlySettings
from lowcostnav_ros.physics.earth import LocalFrame, ecef_to_geodetic

_BRIDGE_NS = 500_000_000
"""How long before an epoch its truth begins: a comparison bridges no more than a second."""
_HELD_EPOCHS = 10
"""Missing epochs in a row that a navigator takes for a gap, not for a wrong stamp."""
LONGEST_INTERVAL_S = 300.0
"""Interval beyond which nothing is done for the navigators: epochs so far apart are fixes, not a flight."""

@dataclass(slots=True)
class RinexReport:
    """What a conversion did.

    Attributes
    ----------
    messages : dict of topic to number written
    epochs : int
        Read from the observation file.
    verdicts : Counter
        Epochs by integrity verdict.
    left_out : Counter
        Satellites not used, by reason.
    unplaced : int
        Epochs not written because no position near them is known to correct them at.
    repeated : int
        Epochs not written because their stamp is not after the one before.
    settings : dict
        Settings by navigator that the recording carries for this receiver.
    remarks : list of str
    """

    messages: dict[str, int] = field(default_factory=dict)
    epochs: int = 0
    verdicts: Counter = field(default_factory=Counter)
    left_out: Counter = field(default_factory=Counter)
    unplaced: int = 0
    repeated: int = 0
    settings: dict = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        """Return lines for a terminal."""
        lines = [f"{count:8d}  {topic}" for topic, count in self.messages.items()]
        lines.append(f"{self.epochs} epochs: {counted(self.verdicts)}")
        if self.left_out:
            lines.append(f"satellites not used: {counted(self.left_out)}")
        if self.unplaced:
            lines.append(f"{self.unplaced} epochs not written, no position within {HOLD_S:.0f} s before them to correct them at")
        if self.repeated:
            lines.append(f"{self.repeated} epochs not written, their time does not increase")
        for name, values in self.settings.items():
            listed = ", ".join(f"{key} {str(value).lower()}" for key, value in values.items())
            lines.append(f"the recording carries settings of {name} for this receiver: {listed}")
        return "\n".join([*lines, *self.remarks])


def convert_rinex(
    observations: str | Path,
    navigation: Sequence[str | Path],
    out_bag: str | Path,
    *,
    at_rest: bool = False,
    on_progress: Callable[[float], None] | None = None,
) -> RinexReport:
    """Convert RINEX observations and ephemerides to a bag.

    Parameters
    ----------
    observations : str or Path
    navigation : sequence of str or Path
        One file or more.
    out_bag : str or Path
        Bag to create.
    at_rest : bool
        The receiver stood at the coordinates in the header: they are recorded as ``truth/odometry``, for a replay to compare with.
    on_progress : callable, optional
        Called with the share done.

    Raises
    ------
    GnssError, ConvertError, BagError
        Each with one sentence that says what to do.
    """
    with new_bag(out_bag) as bag:
        return _converted(observations, navigation, bag, at_rest, on_progress)


def _converted(
    observations: str | Path,
    navigation: Sequence[str | Path],
    bag: BagWriter,
    at_rest: bool,
    on_progress: Callable[[float], None] | None,
) -> RinexReport:
    read, ephemerides = read_observations(observations), read_navigation(navigation)
    if at_rest and read.approx_position_e is None:
        raise ConvertError(f"{observations} has no coordinates in its header to take for the truth; drop --at-rest.")
    total = len(read.epochs)
    followed = track(read.epochs, ephemerides, advance=on_progress and (lambda done: on_progress(done / total)))
    report = RinexReport(epochs=total, verdicts=followed.verdicts(), left_out=followed.rejected + read.rejected)
    report.remarks = [*(sentence for _, sentence in followed.remarks), *read.remarks, *ephemerides.remarks]
    epochs = _kept(followed, report)
    if not epochs:
        raise ConvertError(f"{observations}: no epoch gives a position to correct it at ({followed.located[0].refusal})")
    records = [record for epoch in epochs for record in encode.encode_cdr(epoch)]
    if at_rest and read.approx_position_e is not None:
        records += _truth([epoch.stamp_ns for epoch in epochs], read.approx_position_e)
    write_records(bag, records)
    report.messages = dict(bag.counts)
    report.settings = _settings(any(epoch.doppler_valid.any() for epoch in epochs), min(read.interval_s or 0.0, LONGEST_INTERVAL_S))
    if report.settings:
        _write_settings(report.settings, bag.path / SETTINGS_FOLDER)
    return report


def _kept(followed: Track, report: RinexReport) -> list[GnssEpoch]:
    """Corrected epochs with rising stamps."""
    kept: list[GnssEpoch] = []
    for one in followed.located:
        if one.epoch is None:
            report.unplaced += 1
        elif kept and one.epoch.stamp_ns <= kept[-1].stamp_ns:
            report.repeated += 1
        else:
            kept.append(one.epoch)
    return kept


def _truth(stamps_ns: list[int], reference_e: np.ndarray) -> list[Record]:
    """Truth of a receiver at rest, at each stamp and shortly before it, with its origin."""
    stamps = sorted({t for stamp in stamps_ns for t in (stamp - _BRIDGE_NS, stamp)})
    origin, n = LocalFrame(*ecef_to_geodetic(reference_e)), len(stamps)
    lat, lon, height = (np.full(n, value) for value in (origin.lat, origin.lon, origin.height))
    still = np.zeros((n, 3))
    block = TruthBlock(np.array(stamps), lat, lon, height, still, np.tile((1.0, 0.0, 0.0, 0.0), (n, 1)), still, still, still)
    records = [(stamps[0], "truth/origin", topics.NAV_SAT_FIX, to_cdr(encode.origin_fix(stamps[0], origin)))]
    for row, stamp in enumerate(stamps):
        records.append((stamp, "truth/odometry", topics.ODOMETRY, to_cdr(encode.truth_odometry(block, row, origin))))
    return records


def _settings(doppler: bool, interval_s: float) -> dict[str, dict[str, float | bool]]:
    """What the navigators must know of this receiver, by navigator: no Dopplers, and epochs further apart than flying receivers give."""
    needed: dict[str, dict[str, float | bool]] = {"gnss_only": {}, "ins_gnss": {}}
    if not doppler:
        needed["gnss_only"]["gnss.doppler"] = needed["ins_gnss"]["gnss.doppler"] = False
    defaults = GnssOnlySettings()
    if 2.0 * interval_s > defaults.timeout_s:
        needed["gnss_only"]["timeout_s"] = round(2.0 * interval_s, 3)
    if _HELD_EPOCHS * interval_s > defaults.horizon.jump_s:
        needed["gnss_only"]["horizon.jump_s"] = round(_HELD_EPOCHS * interval_s, 3)
    return {name: values for name, values in needed.items() if values}


def _write_settings(needed: dict[str, dict[str, float | bool]], folder: Path) -> None:
    """Put them into the recording; every other parameter keeps its default."""
    folder.mkdir()
    for name, values in needed.items():
        text = yaml.safe_dump({name: {"ros__parameters": values}}, sort_keys=True)
        (folder / f"{name}.yaml").write_text(f"# What this receiver needs; everything else keeps its default.\n{text}", encoding="utf-8")
