"""The files of a replay that belong to the flight rather than to a navigator."""

import dataclasses
from pathlib import Path

import numpy as np

from lowcostnav_ros.replay import result_files as files
from lowcostnav_ros.replay.columns import NavColumns
from lowcostnav_ros.replay.runs import NavigatorFiles


@dataclasses.dataclass(slots=True)
class SessionFiles:
    """True states, winds, fixes and recorded solutions as tables; none when ``folder`` is None."""

    folder: Path | None
    truth: files.Table | None = None
    wind: files.Table | None = None
    gps: files.Table | None = None
    recorded: dict[str, files.Table] = dataclasses.field(default_factory=dict)

    def open(self) -> None:
        """Create the folder and the files."""
        if self.folder is not None:
            self.folder.mkdir(parents=True, exist_ok=True)
            (self.folder / "summary.json").unlink(missing_ok=True)  # with it, tables that are not finished would look whole
            self.truth = files.Table(self.folder / "truth.csv", files.TRUTH_HEADER)
            self.wind = files.Table(self.folder / "truth_wind.csv", files.TRUTH_WIND_HEADER)
            self.gps = files.Table(self.folder / "gps.csv", files.GPS_HEADER)

    def navigator(self, name: str, smooth: bool) -> NavigatorFiles | None:
        """The files of one navigator."""
        return None if self.folder is None else NavigatorFiles(self.folder, name, smooth)

    def add_truth(self, columns: NavColumns) -> None:
        """Write true states and true wind, whichever the columns hold."""
        if self.truth is not None and np.isfinite(columns.position[0, 0]):
            self.truth.rows(files.truth_rows(columns))
        if self.wind is not None and np.isfinite(columns.wind_n[0, 0]):
            self.wind.rows(files.wind_rows(columns))

    def add_recorded(self, name: str, columns: NavColumns) -> None:
        """Write solutions that the aircraft recorded, those with a position."""
        columns = columns[np.isfinite(columns.position[:, 0])]
        if self.folder is None or not len(columns):
            return
        if name not in self.recorded:
            self.recorded[name] = files.Table(self.folder / f"recorded_{name}.csv", files.SOLUTION_HEADER)
        self.recorded[name].rows(files.solution_rows(columns, [""] * len(columns)))

    def close(self) -> None:
        """Close all files."""
        for table in (self.truth, self.wind, self.gps, *self.recorded.values()):
            if table is not None:
                table.close()
