"""Settings of the dead-reckoning navigator, in the units of data sheets; defaults are the error models of Gebre-Egziabher (2004).

Table 6.1 of the thesis gives wind 5 m/s over 400 s, heading 2.5 deg over 120 s plus 0.8 deg white, airspeed 2.6 m/s over 400 s and
DME 0.17 NM over 0.5 NM of flight plus 0.004 NM white.
"""

from dataclasses import dataclass

from lowcostnav_ros.aids.vor import VorSettings
from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.estimation.aiding import GateSettings
from lowcostnav_ros.navigators.base import HorizonSettings


@dataclass(frozen=True)
class DeadReckoningHorizon(HorizonSettings):
    """The fusion horizon; longer than the AHRS's own, whose fused attitude arrives one lag later."""

    lag_s: float = setting(0.25, "Fusion stays this far behind the newest stamp to outlast transport.", unit="s", minimum=0.0, maximum=10.0)


@dataclass(frozen=True)
class HeadingSettings:
    """Errors of the heading that comes in."""

    bias_deg: float = setting(2.5, "Slowly varying heading error, Gauss-Markov sigma.", unit="deg", minimum=0.0, maximum=45.0)
    bias_tau_s: float = setting(120.0, "Correlation time of the heading error.", unit="s", minimum=1.0)
    offset_deg: float = setting(3.0, "Constant heading error (mounting), sigma; 0 leaves it out.", unit="deg", minimum=0.0, maximum=45.0)
    noise_deg: float = setting(0.8, "White heading noise, sigma at 1 Hz.", unit="deg", minimum=0.0, maximum=45.0)
    timeout_s: float = setting(1.0, "Attitude older than this is not trusted any more.", unit="s", minimum=0.05, maximum=30.0)


@dataclass(frozen=True)
class AirspeedSettings:
    """Errors of the true airspeed that comes in, and the air data that a pitot tube alone does not give."""

    bias_mps: float = setting(2.6, "Airspeed error, Gauss-Markov sigma; 0 leaves it out.", unit="m/s", minimum=0.0, maximum=50.0)
    bias_tau_s: float = setting(400.0, "Correlation time of the airspeed error.", unit="s", minimum=1.0)
    scale: float = setting(0.03, "Constant scale-factor error, sigma as a fraction; 0 leaves it out.", minimum=0.0, maximum=0.5)
    noise_mps: float = setting(0.3, "White airspeed noise, sigma at 1 Hz.", unit="m/s", minimum=0.0, maximum=10.0)
    incidence_deg: float = setting(0.0, "Incidence in level flight, used without a vane.", unit="deg", minimum=-20.0, maximum=20.0)
    slip_deg: float = setting(0.0, "Steady sideslip, air from the right positive, no vane.", unit="deg", minimum=-20.0, maximum=20.0)
    minimum_mps: float = setting(8.0, "Below this airspeed the aircraft counts as on the ground.", unit="m/s", minimum=0.1, maximum=100.0)
    timeout_s: float = setting(2.0, "Airspeed older than this is not trusted any more.", unit="s", minimum=0.05, maximum=30.0)


@dataclass(frozen=True)
class WindSettings:
    """What the air mass does along the flight."""

    sigma_mps: float = setting(5.0, "Variation of each component, Gauss-Markov sigma.", unit="m/s", minimum=0.01, maximum=50.0)
    tau_s: float = setting(400.0, "Correlation time of the variation.", unit="s", minimum=1.0)
    mean_mps: float = setting(10.0, "Constant part, sigma before GPS taught it; 0 leaves it out.", unit="m/s", minimum=0.0, maximum=100.0)
    gust_mps: float = setting(1.0, "Turbulence that is not estimated, sigma of each component.", unit="m/s", minimum=0.0, maximum=20.0)
    gust_tau_s: float = setting(5.0, "Correlation time of the turbulence.", unit="s", minimum=0.1, maximum=100.0)


@dataclass(frozen=True)
class HeightSettings:
    """The vertical channel: pressure altitude with a bias that GPS teaches."""

    climb_mps: float = setting(3.0, "Vertical speed, Gauss-Markov sigma.", unit="m/s", minimum=0.1, maximum=50.0)
    climb_tau_s: float = setting(15.0, "Correlation time of the vertical speed.", unit="s", minimum=0.5, maximum=600.0)
    baro_bias_m: float = setting(150.0, "Pressure altitude minus ellipsoid height, sigma before GPS.", unit="m", minimum=0.1, maximum=1e4)
    baro_drift_m: float = setting(23.0, "Change of that bias, Gauss-Markov sigma.", unit="m", minimum=0.0, maximum=1e3)
    baro_tau_s: float = setting(400.0, "Correlation time of that change.", unit="s", minimum=1.0)
    baro_noise_m: float = setting(1.5, "White noise of one pressure altitude, at least.", unit="m", minimum=0.01, maximum=100.0)


@dataclass(frozen=True)
class GpsSettings:
    """How GPS is used while it lasts."""

    position_floor_m: float = setting(1.5, "Smallest horizontal sigma a fix is given.", unit="m", minimum=0.0, maximum=100.0)
    velocity_floor_mps: float = setting(0.1, "Smallest sigma a GPS velocity is given.", unit="m/s", minimum=0.0, maximum=10.0)
    correlation_s: float = setting(1.0, "Correlation time of receiver errors: fast fixes say little.", unit="s", minimum=0.0, maximum=600.0)
    timeout_s: float = setting(3.0, "Without an accepted fix for this long GPS counts as lost.", unit="s", minimum=0.2, maximum=60.0)
    gate: GateSettings = group(GateSettings)


@dataclass(frozen=True)
class DmeGateSettings(GateSettings):
    """The gate of ranges; they come seconds apart, so recovery takes many of them."""

    recovery_s: float = setting(180.0, "Rejecting this long makes the aid recover (widen or re-initialise).", unit="s", minimum=0.0)


@dataclass(frozen=True)
class DmeSettings:
    """DME slant ranges."""

    stations_file: str = setting(
        "", "Station table; the file name is resolved where the configuration is read.", shipped="dme_stations_bay_area.csv"
    )
    bias: str = setting("estimate", "Range bias: estimated per station or only considered.", choices=("estimate", "consider"))
    bias_nm: float = setting(0.17, "Range bias of a station, Gauss-Markov sigma.", unit="NM", minimum=0.0, maximum=10.0)
    bias_distance_nm: float = setting(0.5, "Distance flown over which the bias stays correlated.", unit="NM", minimum=0.01, maximum=100.0)
    noise_nm: float = setting(0.004, "White range noise.", unit="NM", minimum=1e-5, maximum=1.0)
    slots: int = setting(4, "Stations whose bias is held at one time.", minimum=1, maximum=16)
    timeout_s: float = setting(60.0, "Without an accepted range for this long DME counts as lost.", unit="s", minimum=1.0, maximum=600.0)
    gate: DmeGateSettings = group(DmeGateSettings)


@dataclass(frozen=True)
class RadarGateSettings(GateSettings):
    """The gate of radar fixes; a radar sees the aircraft every few seconds."""

    recovery_s: float = setting(60.0, "Rejecting this long makes the aid recover (widen or re-initialise).", unit="s", minimum=0.0)


@dataclass(frozen=True)
class RadarSettings:
    """Position fixes of a ground radar, sent up by data link."""

    topic: str = setting("", "Topic of the fixes (NavSatFix), such as radar/fix; empty for none.")
    floor_m: float = setting(200.0, "Smallest horizontal sigma a fix is given.", unit="m", minimum=1.0, maximum=1e5)
    gate: RadarGateSettings = group(RadarGateSettings)


@dataclass(frozen=True)
class WindUplinkSettings:
    """Wind reported from the ground by data link."""

    topic: str = setting("", "Topic of the wind (TwistWithCovarianceStamped), such as uplink/wind; empty for none.")
    floor_mps: float = setting(2.0, "Smallest sigma a reported component is given.", unit="m/s", minimum=0.1, maximum=50.0)
    correlation_s: float = setting(600.0, "Time over which the errors of reports stay correlated.", unit="s", minimum=0.0, maximum=1e5)
    gate: DmeGateSettings = group(DmeGateSettings)


@dataclass(frozen=True)
class DeadReckoningSettings:
    """All settings of the dead-reckoning navigator."""

    attitude_topic: str = setting("imu/data_fused", "Topic the attitude is taken from.")
    model: str = setting(
        "full",
        "Error model: full, or reduced to position and wind with range bias as noise (G53).",
        choices=("full", "reduced"),
    )
    alert_nm: float = setting(0.5, "Believed horizontal sigma above which an alert is raised.", unit="NM", minimum=0.01, maximum=100.0)
    ground_walk_mps: float = setting(5.0, "Unknown motion below minimum airspeed, sigma at 1 Hz.", unit="m/s", minimum=0.0, maximum=50.0)
    horizon: DeadReckoningHorizon = group(DeadReckoningHorizon)
    heading: HeadingSettings = group(HeadingSettings)
    airspeed: AirspeedSettings = group(AirspeedSettings)
    wind: WindSettings = group(WindSettings)
    height: HeightSettings = group(HeightSettings)
    gps: GpsSettings = group(GpsSettings)
    dme: DmeSettings = group(DmeSettings)
    vor: VorSettings = group(VorSettings)
    radar: RadarSettings = group(RadarSettings)
    wind_uplink: WindUplinkSettings = group(WindUplinkSettings)
