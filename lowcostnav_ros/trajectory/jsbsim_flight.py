"""An independent aircraft as truth: the Cessna 172 of JSBSim, six degrees of freedom over the rotating WGS-84 earth.

JSBSim integrates forces and moments; nothing of it is shared with the mechanisation under test.  Its geodetic position, velocity and
attitude are the truth, and the ideal IMU is what the inverse strapdown finds between its states.
"""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.base.units import FOOT
from lowcostnav_ros.physics.rotation import eulers_to_quat
from lowcostnav_ros.trajectory.autopilot import Autopilot, Seen, Wanted
from lowcostnav_ros.trajectory.guidance import Fix, Guidance, reference_heights
from lowcostnav_ros.trajectory.manoeuvres import parse_mission
from lowcostnav_ros.trajectory.missions import mission_lines
from lowcostnav_ros.trajectory.trajectory import Trajectory, piece_rows, stamps, with_ideal_imu
from lowcostnav_ros.trajectory.truth_settings import TruthSettings
from lowcostnav_ros.trajectory.wind import Wind

AIRCRAFT = "c172p"
"""The Cessna 172P; its sister c172x has 2.9 degrees of play in the elevator linkage and hunts in pitch under any autopilot."""
CONTROL_HZ = 50
"""Least rate of the autopilot and of the integration."""
LONGEST_S = 6.0 * 3600.0
"""A mission that has not ended by then never will (the tanks are empty)."""
_DRYDEN = 4  # JSBSim's turbulence type: MIL-F-8785C spectra in Tustin form
_SEVERITY_SIGMAS = np.array([0.5, 1.05, 2.4, 3.4, 5.0])
"""Sigma, m/s, that the library's severities 1 to 5 were measured to give 900 to 1500 m above the ground, where they rule alone."""
_WIND_EVERY_S = 0.2  # between values of the steady wind; straight lines in between
_SAMPLED = (
    ("position/lat-geod-rad", 1.0),
    ("position/long-gc-rad", 1.0),
    ("position/geod-alt-ft", FOOT),
    ("velocities/v-north-fps", FOOT),
    ("velocities/v-east-fps", FOOT),
    ("velocities/v-down-fps", FOOT),
    ("attitude/phi-rad", 1.0),
    ("attitude/theta-rad", 1.0),
    ("attitude/psi-rad", 1.0),
    ("atmosphere/total-wind-north-fps", FOOT),
    ("atmosphere/total-wind-east-fps", FOOT),
    ("atmosphere/total-wind-down-fps", FOOT),
    ("velocities/p-rad_sec", 1.0),
    ("velocities/q-rad_sec", 1.0),
    ("velocities/r-rad_sec", 1.0),
    ("aero/beta-rad", 1.0),
    ("velocities/vt-fps", FOOT),
)
_SCALES = np.array([scale for _, scale in _SAMPLED])


def build_jsbsim(settings: TruthSettings, seed: int) -> Trajectory:
    """Flight of a mission by the flight-dynamics aircraft; see :func:`lowcostnav_ros.trajectory.build`.

    Raises
    ------
    SettingsError
        For a mission line that is not understood, or a start the aircraft cannot be trimmed at.
    """
    mission = parse_mission(mission_lines(settings))
    Aircraft(settings, seed, np.zeros(3))  # refuse an impossible start now, not in the middle of a stream

    def pieces() -> Iterator[TruthBlock]:
        return with_ideal_imu(_states(settings, seed, mission))

    return Trajectory(settings.rate_hz, settings.start_ns, pieces)


def _states(settings: TruthSettings, seed: int, mission: list) -> Iterator[TruthBlock]:
    wind = Wind(settings.wind, seed, settings.start.height_m, settings.start.airspeed_mps)
    aircraft = Aircraft(settings, seed, wind.steady(np.zeros(1), np.array([settings.start.height_m]))[0])
    pilot = Pilot(settings, mission, wind, aircraft)
    last = round((settings.duration_s or LONGEST_S) * settings.rate_hz)
    rows = [aircraft.sample()]
    first = 0
    for k in range(1, last + 1):
        pilot.fly(aircraft)
        rows.append(aircraft.sample())
        ended = k == last or (not settings.duration_s and pilot.guidance.done)
        if ended or len(rows) >= piece_rows(settings.rate_hz):
            yield _block(settings, first, np.array(rows) * _SCALES)
            first, rows = k + 1, []
        if ended:
            return


def _block(settings: TruthSettings, first: int, columns: np.ndarray) -> TruthBlock:
    stamps_ns = stamps(settings.start_ns, settings.rate_hz, np.arange(first, first + len(columns)))
    lat, lon, height = columns[:, :3].T.copy()
    none = np.zeros((len(columns), 3))
    quats = eulers_to_quat(np.ascontiguousarray(columns[:, 6:9]))
    return TruthBlock(stamps_ns, lat, lon, height, columns[:, 3:6].copy(), quats, none, none, columns[:, 9:12].copy())


class Aircraft:
    """JSBSim's Cessna, trimmed in the air, stepped at an exact fraction of the sample interval.

    Parameters
    ----------
    settings : TruthSettings
    seed : int
        Seed of its turbulence.
    wind_n : ndarray, shape (3,)
        Velocity of the air mass at the start, NED m/s, horizontal.

    Raises
    ------
    SettingsError
        If it cannot be trimmed at the start.
    """

    def __init__(self, settings: TruthSettings, seed: int, wind_n: np.ndarray) -> None:
        self.fdm = _quiet_fdm()
        self.steps_per_row = max(1, math.ceil(CONTROL_HZ / settings.rate_hz))
        self.dt = 1.0 / (settings.rate_hz * self.steps_per_row)
        self.fdm.set_dt(self.dt)
        self._place(settings)
        self._trim(settings)
        self._join_air_mass(settings, wind_n)
        self._turbulence(settings, seed)
        manager = self.fdm.get_property_manager()
        self._read = [manager.get_node(name, False).get_double_value for name, _ in _SAMPLED]
        controls = ("fcs/aileron-cmd-norm", "fcs/elevator-cmd-norm", "fcs/rudder-cmd-norm", "fcs/throttle-cmd-norm")
        self._set_wind = [manager.get_node(f"atmosphere/wind-{axis}-fps", False).set_double_value for axis in ("north", "east", "down")]
        self._controls = [manager.get_node(name, False).set_double_value for name in controls]

    def sample(self) -> list[float]:
        """Present values of what is sampled, in JSBSim's units."""
        return [read() for read in self._read]

    def control(self, commands: tuple[float, float, float, float]) -> None:
        """Set (aileron, elevator, rudder, throttle)."""
        for write, value in zip(self._controls, commands, strict=True):
            write(value)

    def set_wind(self, wind_n: np.ndarray) -> None:
        """Set the air mass's steady velocity, NED m/s."""
        for write, value in zip(self._set_wind, wind_n, strict=True):
            write(value / FOOT)

    def _place(self, settings: TruthSettings) -> None:
        start, fdm = settings.start, self.fdm
        fdm["ic/lat-geod-deg"], fdm["ic/long-gc-deg"] = start.lat_deg, start.lon_deg
        fdm["ic/h-sl-ft"] = start.height_m / FOOT  # JSBSim's sea level is the ellipsoid
        fdm["ic/psi-true-deg"] = start.heading_deg
        fdm["ic/vt-fps"] = start.airspeed_mps / FOOT

    def _trim(self, settings: TruthSettings) -> None:
        import jsbsim

        self.fdm.run_ic()
        self.fdm["propulsion/set-running"] = -1
        self.fdm["fcs/mixture-cmd-norm"] = 0.87
        try:
            self.fdm.do_trim(1)
        except jsbsim.TrimFailureError:
            start = settings.start
            raise SettingsError(
                f"The aircraft cannot fly level at {start.airspeed_mps:g} m/s and {start.height_m:g} m; start lower, at 40 to 60 m/s."
            ) from None

    def _join_air_mass(self, settings: TruthSettings, wind_n: np.ndarray) -> None:
        """Start again with the trimmed attitude and controls, moving with the air mass: the library trims over ground only."""
        fdm = self.fdm
        north, east, down = (fdm[f"velocities/v-{axis}-fps"] for axis in ("north", "east", "down"))
        attitude = fdm["attitude/phi-deg"], fdm["attitude/theta-deg"]
        fdm["ic/vw-mag-fps"] = math.hypot(wind_n[0], wind_n[1]) / FOOT
        fdm["ic/vw-dir-deg"] = math.degrees(math.atan2(wind_n[1], wind_n[0]))  # where the air moves to
        fdm["ic/phi-deg"], fdm["ic/theta-deg"] = attitude
        fdm["ic/psi-true-deg"] = settings.start.heading_deg
        fdm["ic/vn-fps"], fdm["ic/ve-fps"], fdm["ic/vd-fps"] = north + wind_n[0] / FOOT, east + wind_n[1] / FOOT, down
        fdm.run_ic()

    def _turbulence(self, settings: TruthSettings, seed: int) -> None:
        fdm, sigma = self.fdm, settings.wind.turbulence_sigma_mps
        fdm["simulation/randomseed"] = fdm["atmosphere/randomseed"] = float(seed % 2**31 + 1)
        if sigma:  # in MIL-F-8785C the vertical sigma near the ground is a tenth of the wind at 20 ft, aloft a table by severity
            fdm["atmosphere/turb-type"] = _DRYDEN
            fdm["atmosphere/turbulence/milspec/windspeed_at_20ft_AGL-fps"] = 10.0 * sigma / FOOT
            fdm["atmosphere/turbulence/milspec/severity"] = float(1 + np.abs(_SEVERITY_SIGMAS - sigma).argmin())


class Pilot:
    """Guidance and autopilot in the loop with the aircraft."""

    def __init__(self, settings: TruthSettings, mission: list, wind: Wind, aircraft: Aircraft) -> None:
        height, dt = settings.start.height_m, aircraft.dt
        self._wind, self._dt, self._steps = wind, dt, 0
        self._wind_now = wind.steady(np.zeros(1), np.array([height]))[0]
        self._wind_rate = np.zeros(3)
        self._wind_steps = max(1, round(_WIND_EVERY_S / dt))
        self._control_steps = max(1, round(1.0 / (CONTROL_HZ * dt)))
        self.guidance = Guidance(mission, self._fix(aircraft.sample()))
        self._reference = reference_heights(self.guidance.order, height, self._control_steps * dt)
        fdm = aircraft.fdm
        elevator = fdm["fcs/elevator-cmd-norm"] + fdm["fcs/pitch-trim-cmd-norm"]
        fdm["fcs/pitch-trim-cmd-norm"] = 0.0
        self._autopilot = Autopilot(elevator, fdm["fcs/aileron-cmd-norm"], fdm["fcs/throttle-cmd-norm"], fdm["attitude/theta-rad"])

    def fly(self, aircraft: Aircraft) -> None:
        """Fly one sample interval."""
        for _ in range(aircraft.steps_per_row):
            if self._steps % self._control_steps == 0:
                aircraft.control(self._commands(aircraft.sample()))
            self._move_air(aircraft)
            aircraft.fdm.run()
            self._steps += 1

    def _move_air(self, aircraft: Aircraft) -> None:
        """Set the steady wind for the coming step, along straight lines between its values every so often."""
        if self._steps % self._wind_steps == 0:
            ahead_s, height = (self._steps + self._wind_steps) * self._dt, aircraft.fdm["position/geod-alt-ft"] * FOOT
            ahead = self._wind.steady(np.array([ahead_s]), np.array([height]))[0]
            self._wind_rate = (ahead - self._wind_now) / self._wind_steps
        self._wind_now = self._wind_now + self._wind_rate
        aircraft.set_wind(self._wind_now)

    def _fix(self, now: list[float]) -> Fix:
        wind = self._wind_now
        return Fix(self._steps * self._dt, now[0], now[1], now[2] * FOOT, now[8], now[16] * FOOT, wind[0], wind[1])

    def _commands(self, now: list[float]) -> tuple[float, float, float, float]:
        self.guidance.update(self._fix(now))
        order = self.guidance.order
        height, climb = next(self._reference)
        want = Wanted(self.guidance.heading_error, order.bank_ahead, order.max_bank, height, climb, order.airspeed)
        see = Seen(now[6], now[7], now[12], now[13], now[15], now[16] * FOOT, now[2] * FOOT, -now[5] * FOOT)
        return self._autopilot.step(want, see, self._control_steps * self._dt)


def _quiet_fdm() -> Any:
    import jsbsim

    class Silent(jsbsim.FGLogger):
        """Swallows the library's console reports; failures come as exceptions."""

        def set_level(self, level: object) -> None:
            pass

        def file_location(self, filename: str, line: int) -> None:
            pass

        def message(self, message: str) -> None:
            pass

        def format(self, format: object) -> None:
            pass

        def flush(self) -> None:
            pass

    jsbsim.set_logger(Silent())
    fdm = jsbsim.FGFDMExec(None)
    fdm.set_debug_level(0)
    fdm.load_model(AIRCRAFT)
    return fdm
