"""Pseudolite/INS: the strapdown core aided by the code and the carrier of ground transmitters, for where there is no GPS.

Fifteen states (core nine, accelerometer and gyro biases), the receiver's clock, and an ambiguity for every carrier that is tracked
(Kawecki 2015).  A factor on the troposphere's delay, the lever arm and slow errors of the carriers may be states, too.  Barometer, GPS
fixes, satellites one by one, differenced GPS carrier and two-way ranges are further entries of the list.  Any number of transmitters helps.
"""

from lowcostnav_ros.aids._carrier import ENOUGH, CarrierAid
from lowcostnav_ros.aids.airdata import AIRDATA
from lowcostnav_ros.aids.baro import BARO
from lowcostnav_ros.aids.gps import GPS
from lowcostnav_ros.aids.magnetic import MAGNETIC
from lowcostnav_ros.aids.pseudolite import PSEUDOLITE_AID
from lowcostnav_ros.aids.ranging import RangingAid
from lowcostnav_ros.base.measurements import CarrierEpoch, Measurement, StationWeather
from lowcostnav_ros.base.modes import Mode
from lowcostnav_ros.navigators.inertial import IMU, InertialNavigator, InertialSettings
from lowcostnav_ros.navigators.registry import navigator
from lowcostnav_ros.starts.code_start import code_solution

PSEUDOLITE = "pseudolite"
RAW = "pseudolite/raw"
HEIGHT_LOST_M = 100.0
"""With few ranges and a height known no better, the ranges are no longer linear in the place, and sigmas not to be believed."""
ENOUGH_BEACONS = 3
"""Two-way ranges need no clock."""


@navigator
class PseudoliteIns(InertialNavigator):
    """Pseudolite/INS navigator; see the module head.

    Modes: those of the GPS/INS navigator; ``pseudolite``, four transmitters or more hold the position; ``sparse``, one to three do.
    """

    name = "pseudolite_ins"
    colour = "#8c564b"
    healthy_modes = ("gps", "calibrating", "pseudolite")
    modes = {"sparse": ("#b8b042", "with fewer than four satellites or transmitters"), "suspect": ("#d95f02", "")}
    OwnSettings = InertialSettings
    sensors = (GPS, PSEUDOLITE_AID, BARO, MAGNETIC.but(enabled=False), AIRDATA.but(enabled=False))
    needs = ("gps", "pseudolite")
    required = (IMU, RAW)
    fix_word = "transmitter"
    tries_headings = False  # ambiguities of carriers are of one state

    def gps_good(self, stamp_ns: int) -> bool:
        """Whether the solution is held, by GPS or by transmitters."""
        return self.mode in (Mode.GPS, PSEUDOLITE)

    def _restart(self) -> None:
        super()._restart()
        self._receivers_of_carriers = self.aids_of(CarrierAid)

    def _prepare(self, item: Measurement) -> None:
        """Align on GPS, or on the code and the Dopplers of four transmitters."""
        if isinstance(item, StationWeather):
            self._aid(item)
        if not isinstance(item, CarrierEpoch):
            super()._prepare(item)
            return
        receiver = next(aid for aid in self._receivers_of_carriers if aid.source == item.source)
        found = code_solution(receiver, item)
        if isinstance(found, str):
            self.mode, self.reason = Mode.ALIGNING, found
            return
        for part in found:
            super()._prepare(part)

    def _judge(self, *, speaks: bool = True) -> None:
        super()._judge(speaks=speaks)
        if self.mode != Mode.GPS:
            return
        used = sum(aid.used for aid in self._receivers_of_carriers if aid.is_fresh(self.core.t_ns))
        if any(aid.is_fresh(self.core.t_ns) for aid in self.trust.receivers):
            return
        beacons = sum(len(aid.used_lately(self.core.t_ns)) for aid in self.aids_of(RangingAid))
        self.mode = PSEUDOLITE if used >= ENOUGH or beacons >= ENOUGH_BEACONS else Mode.SPARSE
        self.reason = f"{used} transmitters" + (f", {beacons} beacons" if beacons else "")
        height_sigma = float(self.core.P[2, 2]) ** 0.5
        if self.mode == Mode.SPARSE and height_sigma > HEIGHT_LOST_M:
            self.mode, self.reason = Mode.FAILED, f"{self.reason} do not hold the height: sigma {height_sigma:.0f} m; add a barometer"


PseudoliteInsSettings = PseudoliteIns.Settings
