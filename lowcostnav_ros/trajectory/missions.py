"""Standard missions near Livermore, California, where the dead-reckoning flights of 1999-2001 were made."""

import dataclasses
from typing import Any

from lowcostnav_ros.base.settings import SettingsError, nearest
from lowcostnav_ros.trajectory.truth_settings import StartSettings, TruthSettings

# The threshold of runway 25L, about; the field is 122 m above the sea and the geoid is 32 m below the ellipsoid here.
_RUNWAY_25L = "approach lat_deg=37.6915 lon_deg=-121.8110 height_m=90"
# 16 statute miles east and 6 north of the field: the point of the 360-degree turns.
_TURNS_LAT_DEG, _TURNS_LON_DEG = 37.7770, -121.5280

MISSIONS: dict[str, tuple[StartSettings, tuple[str, ...]]] = {
    "demo": (
        StartSettings(lat_deg=37.69, lon_deg=-121.82, height_m=600.0, heading_deg=250.0, airspeed_mps=50.0),
        (
            "climb to_height_m=800 rate_mps=2.5",
            "turn by_deg=60 bank_deg=20",
            "speed to_mps=54",
            "s_turns count=4 by_deg=60 bank_deg=25",
            "goto lat_deg=37.725 lon_deg=-121.975",
            "hold inbound_deg=100 leg_s=30 laps=1 bank_deg=20",
            "descend to_height_m=480 rate_mps=4.5",
            f"{_RUNWAY_25L} glide_deg=3 end_above_m=150",
        ),
    ),
    "turns_then_approach": (
        StartSettings(lat_deg=_TURNS_LAT_DEG, lon_deg=_TURNS_LON_DEG + 0.0091, height_m=1200.0, heading_deg=0.0, airspeed_mps=52.0),
        (
            f"orbit lat_deg={_TURNS_LAT_DEG} lon_deg={_TURNS_LON_DEG} radius_m=800 laps=11.25 side=left",
            "straight duration_s=5",
            f"{_RUNWAY_25L} glide_deg=3 end_above_m=60",
        ),
    ),
    "banked_turns": (
        StartSettings(height_m=1200.0, heading_deg=90.0, airspeed_mps=50.0),
        # At 50 m/s and 20 degrees of bank the turn rate is 4.09 deg/s: 60 s of turn with smooth entries is near 228 degrees.
        ("straight duration_s=120", "turn by_deg=228 bank_deg=20", "straight duration_s=120", "turn by_deg=-228 bank_deg=20") * 3
        + ("straight duration_s=120",),
    ),
    "straight": (StartSettings(height_m=900.0), ("straight duration_s=600",)),
}


def standard(name: str, **changes: Any) -> TruthSettings:
    """Settings of a standard mission at its own start; ``changes`` replace top-level fields (``kind='jsbsim'``).

    Raises
    ------
    SettingsError
        If there is no such mission.
    """
    start, _ = _mission(name)
    return dataclasses.replace(TruthSettings(name=name, start=start), **changes)


def mission_lines(settings: TruthSettings) -> tuple[str, ...]:
    """Manoeuvre lines of a flight: its own, or those of the standard mission it names."""
    return tuple(settings.mission) or _mission(settings.name)[1]


def _mission(name: str) -> tuple[StartSettings, tuple[str, ...]]:
    if name not in MISSIONS:
        raise SettingsError(f"There is no mission '{name}'{nearest(name, MISSIONS)}.")
    return MISSIONS[name]
