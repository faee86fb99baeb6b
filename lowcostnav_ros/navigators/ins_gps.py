"""GPS/INS: an error-state extended Kalman filter around a strapdown mechanisation, loosely coupled.

Fifteen states (core nine, accelerometer and gyro biases) with GPS position and velocity; blocks for scale factors, baro, magnetic
heading, wind, airspeed and the receiver's slow error come and go with the list of sensors.  While GPS is good the air data teaches the
wind and moves nothing else; in an outage it holds the velocity.
"""

from lowcostnav_ros.aids.airdata import AIRDATA
from lowcostnav_ros.aids.baro import BARO
from lowcostnav_ros.aids.gps import GPS
from lowcostnav_ros.aids.magnetic import MAGNETIC
from lowcostnav_ros.aids.vor import VOR
from lowcostnav_ros.aids.wheels import WHEELS
from lowcostnav_ros.navigators.inertial import IMU, InertialNavigator, InertialSettings
from lowcostnav_ros.navigators.registry import navigator

AIR = AIRDATA.but(noise_mps=1.0, sideslip_sigma_deg=1.0, wind_mps=1.5, wind_spread=2.0, minimum_mps=12.0, period_s=1.0)
"""Gusts last for seconds: more often than once in one they say the same.  Over 20 km, 400 s at 50 m/s, wind varies by some 1.5 m/s (the
structure function of Lindborg, J. Fluid Mech. 388, 1999)."""

COMPASS = MAGNETIC.but(bias_deg=1.0)
"""Hard iron is a state and the tilt is the filter's own: what is left is soft iron."""


@navigator
class InsGps(InertialNavigator):
    """GPS/INS navigator; see the module head."""

    name = "ins_gps"
    colour = "#0072b2"
    OwnSettings = InertialSettings
    sensors = (GPS, BARO, COMPASS, AIR, WHEELS, VOR)
    needs = ("gps",)
    required = (IMU, "gps/fix", "gps/vel")


InsGpsSettings = InsGps.Settings
