"""Fly a true flight in real time: /clock, truth/imu, truth/odometry, truth/wind, truth/origin."""

import sys
from typing import Any

from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.messages import encode
from lowcostnav_ros.messages.store import to_cdr
from lowcostnav_ros.physics.earth import LocalFrame
from lowcostnav_ros.ros.run import run
from lowcostnav_ros.ros.scenario import flight_bases
from lowcostnav_ros.ros.source_node import SourceNode
from lowcostnav_ros.trajectory import build

STATE_PERIOD_NS = 50_000_000


class TruthSource(SourceNode):
    """Publish the truth at the pace of the clock on the wall; the inertial sample first, so that states find it."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("truth_source", flight_bases, **kwargs)

    def make_outputs(self) -> None:
        """Make the publishers of the truth."""
        self._imu, self._odometry, self._wind, self._origin = (
            self.output(f"truth/{part}") for part in ("imu", "odometry", "wind", "origin")
        )

    def speak(self) -> None:
        """Fly."""
        truth, flight = self.parameters.settings[:2]
        origin, next_state_ns = None, 0
        for block in build(truth, flight.seed).blocks():
            if origin is None:
                origin = LocalFrame(float(block.lat[0]), float(block.lon[0]), float(block.height[0]))
                self._origin.send(to_cdr(encode.origin_fix(int(block.stamps_ns[0]), origin)))
                next_state_ns = int(block.stamps_ns[0])
            for row, stamp_ns in enumerate(block.stamps_ns.tolist()):
                if not self.at(stamp_ns):
                    return
                self._imu.send(to_cdr(encode.truth_imu(block, row)))
                if stamp_ns >= next_state_ns:
                    self._send_state(block, row, origin)
                    next_state_ns += STATE_PERIOD_NS

    def _send_state(self, block: TruthBlock, row: int, origin: LocalFrame) -> None:
        self._odometry.send(to_cdr(encode.truth_odometry(block, row, origin)))
        self._wind.send(to_cdr(encode.truth_wind(block, row)))


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run(TruthSource, args)


if __name__ == "__main__":
    sys.exit(main())
