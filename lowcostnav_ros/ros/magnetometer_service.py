"""Magnetometer calibration in flight: a service starts the collection, another ends it, fits, and writes the settings to load.

The running estimator is left alone: what it flies on must be what a replay of the recording flies on.  The file takes effect when the
node is started with it.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from rclpy.node import Node
from std_srvs.srv import Trigger

from lowcostnav_ros.base.measurements import MagneticField, Measurement
from lowcostnav_ros.calibration.magnetometer_collection import MagnetometerCollection
from lowcostnav_ros.calibration.magnetometer_fit import calibration_of
from lowcostnav_ros.calibration.profile_text import calibration_text
from lowcostnav_ros.calibration.record import CalibrationError
from lowcostnav_ros.ros.input_monitor import OK, Status

MICRO = 1e6
"""The collection works in microtesla, as the file it ends in does."""


class MagnetometerService:
    """Collects the raw field while it is asked to; ``~/calibrate_start`` and ``~/calibrate_stop`` (std_srvs/Trigger).

    Parameters
    ----------
    node : Node
    navigator : Navigator
        One with an attitude and a ``magnetic`` reference; its output judges which directions have been seen.
    folder : Path
        Where the file goes.
    """

    def __init__(self, node: Node, navigator: Any, folder: Path) -> None:
        self._node, self.navigator, self._folder = node, navigator, folder
        self._collection: MagnetometerCollection | None = None
        node.create_service(Trigger, "~/calibrate_start", self._start)
        node.create_service(Trigger, "~/calibrate_stop", self._stop)

    def take(self, measurement: Measurement) -> None:
        """Look at a measurement on its way to the navigator."""
        if self._collection is None or not isinstance(measurement, MagneticField):
            return
        solution = self.navigator.output()
        if solution is not None and solution.q_nb is not None:
            self._collection.collect(measurement.field_b * MICRO, solution.q_nb)

    def rows(self) -> Iterable[Status]:
        """Diagnostics while collecting."""
        if self._collection is not None:
            progress = self._collection.progress()
            values = {"samples": str(progress.samples), "share": f"{progress.share:.2f}"}
            yield Status(f"{self._node.get_name()}: magnetometer calibration", OK, progress.advice, values)

    def _start(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        place = self.navigator.magnetic.place
        model = self.navigator.magnetic.reference.model
        if place is None or model is None:
            response.success = False
            response.message = "Cannot start: the earth's field here is not known; wait for a GPS fix, or set 'place'."
            return response
        self._collection = MagnetometerCollection(model.field_n(*place) * MICRO)
        response.success, response.message = True, f"Collecting. {self._collection.progress().advice}"
        return response

    def _stop(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        collection, self._collection = self._collection, None
        if collection is None:
            response.success, response.message = False, "No collection is running; call ~/calibrate_start first."
            return response
        try:
            fit = collection.finish()
            path = self._free_path()
            path.write_text(calibration_text(calibration_of(fit, "uT"), fit, "a flight"), encoding="utf-8")
        except CalibrationError as refusal:
            response.success, response.message = False, str(refusal)
        except OSError as error:
            response.success, response.message = False, f"The fit is good, but {error.filename} cannot be written: {error.strerror}."
        else:
            response.success, response.message = True, f"Written to {path}; start the node with --params-file {path} to fly on it."
        return response

    def _free_path(self) -> Path:
        number = 1
        while (path := self._folder / f"magnetometer_{number}.yaml").exists():
            number += 1
        return path
