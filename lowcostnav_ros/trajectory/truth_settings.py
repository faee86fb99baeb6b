"""Settings of a true flight: which kind, from where, how fast sampled, through what wind."""

from dataclasses import dataclass

from lowcostnav_ros.base.settings import SettingsError, group, setting

KINDS = ("segments", "aerobatics", "dataset", "jsbsim", "recorded")


@dataclass(frozen=True)
class StartSettings:
    """Where and how the flight starts (datasets: where only)."""

    lat_deg: float = setting(37.69, "Geodetic latitude of the start, north positive", unit="deg", minimum=-85.0, maximum=85.0)
    lon_deg: float = setting(-121.82, "Longitude of the start, east positive", unit="deg", minimum=-180.0, maximum=180.0)
    height_m: float = setting(600.0, "Height of the start above the ellipsoid", unit="m", minimum=-400.0, maximum=15000.0)
    heading_deg: float = setting(250.0, "True heading at the start", unit="deg", minimum=-360.0, maximum=360.0)
    airspeed_mps: float = setting(50.0, "True airspeed at the start", unit="m/s", minimum=20.0, maximum=300.0)


@dataclass(frozen=True)
class WindSettings:
    """Motion of the air mass: a mean, a slow variation, turbulence."""

    north_mps: float = setting(0.0, "Mean velocity of the air mass toward north", unit="m/s", minimum=-60.0, maximum=60.0)
    east_mps: float = setting(0.0, "Mean velocity of the air mass toward east (from the west: +)", unit="m/s", minimum=-60.0, maximum=60.0)
    variation_sigma_mps: float = setting(
        0.0, "Sigma of the slow variation of each horizontal component (airline data: 5)", unit="m/s", minimum=0.0, maximum=20.0
    )
    variation_tau_s: float = setting(400.0, "Correlation time of that variation", unit="s", minimum=5.0, maximum=1.0e5)
    pattern: str = setting("none", "Periodic wind on top: sinusoidal, or a triangle (shear)", choices=("none", "sinusoidal", "triangle"))
    pattern_mps: float = setting(10.0, "Amplitude of the periodic wind", unit="m/s", minimum=0.0, maximum=60.0)
    pattern_north_s: float = setting(160.0, "Its period in the northward component", unit="s", minimum=5.0, maximum=1.0e5)
    pattern_east_s: float = setting(240.0, "... and in the eastward one", unit="s", minimum=5.0, maximum=1.0e5)
    shear_north_per_s: float = setting(0.0, "Growth of the northward wind with height", unit="1/s", minimum=-0.05, maximum=0.05)
    shear_east_per_s: float = setting(0.0, "Growth of the eastward wind with height", unit="1/s", minimum=-0.05, maximum=0.05)
    turbulence_sigma_mps: float = setting(
        0.0, "Turbulence, sigma of each component (segments: level ones); 1 is light", unit="m/s", minimum=0.0, maximum=6.0
    )


@dataclass(frozen=True)
class TruthSettings:
    """Settings of the truth source: one true flight, made as 'kind' selects; the same settings and seed give the same flight to the bit.

    A manoeuvre is a verb and named values: straight, turn, heading, climb, descend, speed, s_turns, hold, goto, orbit, approach.
    """

    kind: str = setting(
        "segments", "How the truth is made: closed-form manoeuvres, aerobatics, thesis dataset, flight dynamics, a recording", choices=KINDS
    )
    name: str = setting("demo", "Standard mission (demo, turns_then_approach, banked_turns, straight) or dataset (LD, LD-gentle, HD, STR)")
    mission: list[str] = setting([], "Own manoeuvres, one per line such as 'turn by_deg=90 bank_deg=20'; empty flies the standard mission")
    recording: str = setting("", "CSV file of a recorded flight, kind recorded only")
    rate_hz: int = setting(100, "Inertial sampling rate", unit="Hz", minimum=10, maximum=1000)
    duration_s: float = setting(0.0, "Length of the flight; 0 flies to the end of what is flown", unit="s", minimum=0.0, maximum=1.0e5)
    start_stamp_s: float = setting(1780336800.0, "Time of the start since 1970, UTC", unit="s", minimum=0.0, maximum=4.0e9)
    incidence_deg: float = setting(2.0, "Incidence of the body x axis above the airflow (segments)", unit="deg", minimum=0.0, maximum=12.0)
    start: StartSettings = group(StartSettings)
    wind: WindSettings = group(WindSettings)

    def __post_init__(self) -> None:
        if self.kind == "recorded" and not self.recording:
            raise SettingsError("A recorded flight needs its file: set 'recording' to a CSV path.")
        if self.kind in ("aerobatics", "dataset", "recorded") and self.mission:
            raise SettingsError(f"Kind '{self.kind}' flies no manoeuvres: remove 'mission', or set kind to segments or jsbsim.")

    @property
    def start_ns(self) -> int:
        """Time of the start, integer nanoseconds."""
        whole = int(self.start_stamp_s)
        return whole * 1_000_000_000 + round((self.start_stamp_s - whole) * 1e9)
