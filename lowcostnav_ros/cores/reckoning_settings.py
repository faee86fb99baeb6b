"""Settings of the reckoning core, in the units of data sheets; defaults are the error models of Gebre-Egziabher (2004).

Table 6.1 of the thesis gives wind 5 m/s over 400 s, heading 2.5 deg over 120 s plus 0.8 deg white and airspeed 2.6 m/s over 400 s.
"""

from dataclasses import dataclass

from lowcostnav_ros.base.settings import group, setting


@dataclass(frozen=True)
class HeadingSettings:
    """Errors of the heading that comes in."""

    bias_deg: float = setting(2.5, "Slowly varying heading error, Gauss-Markov sigma.", unit="deg", minimum=0.0, maximum=45.0)
    bias_tau_s: float = setting(120.0, "Correlation time of the heading error.", unit="s", minimum=1.0)
    offset_deg: float = setting(3.0, "Constant heading error (mounting), sigma; 0 leaves it out.", unit="deg", minimum=0.0, maximum=45.0)
    noise_deg: float = setting(0.8, "White heading noise, sigma at 1 Hz.", unit="deg", minimum=0.0, maximum=45.0)
    timeout_s: float = setting(1.0, "Attitude older than this has timed out.", unit="s", minimum=0.05, maximum=30.0)


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
    timeout_s: float = setting(2.0, "Airspeed older than this has timed out.", unit="s", minimum=0.05, maximum=30.0)


@dataclass(frozen=True)
class WindSettings:
    """What the air mass does along the flight."""

    sigma_mps: float = setting(5.0, "Variation of each component, Gauss-Markov sigma.", unit="m/s", minimum=0.01, maximum=50.0)
    tau_s: float = setting(400.0, "Correlation time of the variation.", unit="s", minimum=1.0)
    mean_mps: float = setting(10.0, "Constant part, sigma before GPS; 0 leaves it out.", unit="m/s", minimum=0.0, maximum=100.0)
    gust_mps: float = setting(1.0, "Turbulence that is not estimated, sigma of each component.", unit="m/s", minimum=0.0, maximum=20.0)
    gust_tau_s: float = setting(5.0, "Correlation time of the turbulence.", unit="s", minimum=0.1, maximum=100.0)


@dataclass(frozen=True)
class HeightSettings:
    """The vertical channel."""

    climb_mps: float = setting(3.0, "Vertical speed, Gauss-Markov sigma.", unit="m/s", minimum=0.1, maximum=50.0)
    climb_tau_s: float = setting(15.0, "Correlation time of the vertical speed.", unit="s", minimum=0.5, maximum=600.0)


@dataclass(frozen=True)
class ReckoningSettings:
    """What the core is made of."""

    model: str = setting(
        "full",
        "Error model: full, or reduced to position and wind with range bias as noise (G53).",
        choices=("full", "reduced"),
    )
    ground_walk_mps: float = setting(5.0, "Unknown motion below minimum airspeed, sigma at 1 Hz.", unit="m/s", minimum=0.0, maximum=50.0)
    heading: HeadingSettings = group(HeadingSettings)
    airspeed: AirspeedSettings = group(AirspeedSettings)
    wind: WindSettings = group(WindSettings)
    height: HeightSettings = group(HeightSettings)
