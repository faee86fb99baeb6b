"""The cascade core: an inertial solution that runs free, and two filters of three biases beside it (Njenga 2008, chapters 2 and 3).

    feet      N = R dL, E = R dl cos L, up                                      (1), (2)
    INS       a = C (u - b_a) + s g;   [p v a] <- [p v a] phi                    (7) to (14), (45), (46)
    GPS       v = dp/dt, a = dv/dt, fourth-order Butterworth                     (15), (16)
    z_a       u - C' (a_gps - s g)       state b_a, body axes                    (17), (18), (27) to (36)
    z_p       p_ins - p_gps              state b_p, NED                          (19), (37) to (44)
    out       p = p_ins - b_p

u is specific force and s = 1, or, as printed, u counts gravity positive and s = -1: at rest the same, in motion with the opposite sign of
the motion.  Everything is SI; the printed numbers are converted where they are settings.
"""

import copy
import math
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.measurements import UNKNOWN_VARIANCE, Attitude, GpsPosition
from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.base.units import FOOT, STANDARD_GRAVITY
from lowcostnav_ros.cores.carried import AXES, HeldReference
from lowcostnav_ros.cores.views import Motion
from lowcostnav_ros.estimation.aiding import GateSettings, SensorSettings
from lowcostnav_ros.estimation.error_state import Block, Kind, Layout
from lowcostnav_ros.physics.earth import gravity, radii
from lowcostnav_ros.physics.rotation import euler_to_dcm, quat_rotate, quat_to_dcm, quat_to_euler, wrap

SPHERE_M = 20_925_646.0 * FOOT
"""Radius of the sphere of (1), (2); the thesis prints none: that of the equator."""
DEGREES_PER_RADIAN, FEET_PER_G = 57.3, 32.2
"""The constants of (3) to (6) and (11) as they are printed."""
HOLE_S = 5.0
"""Fixes farther apart are not differentiated."""
MEMORY_S = 30.0
"""Over this time what the position filter is off by is averaged: its own covariance does not know that it lags."""
SMOOTH_S = 2.0
"""Time constant of the rate of the position bias."""
LEAST = 1e-6


@dataclass(frozen=True)
class CascadeSettings(SensorSettings):
    """The two filters of three states; R and Q in feet and seconds, for one step."""

    constants: str = setting(
        "consistent", "Feet by a sphere, 57.3 and 32.2 as printed, or by ellipsoid and local gravity.", choices=("consistent", "thesis")
    )
    compare: str = setting(
        "epoch", "Offset at a sample: that at the last fix, or from it held or extrapolated.", choices=("epoch", "held", "extrapolated")
    )
    filter_rate: str = setting("attitude", "Both filters step with every attitude, or with every fix.", choices=("attitude", "gps"))
    step_s: float = setting(0.05, "Step that Q and R are of; 0: of whatever step comes.", unit="s", minimum=0.0, maximum=10.0)
    match_delay: bool = setting(True, "Differentiate and filter accelerations as those of GPS, so that both are late by the same.")
    cutoff_hz: float = setting(0.1, "Corner of the Butterworth filter of GPS accelerations; 0: none.", unit="Hz", minimum=0.0, maximum=10.0)
    initial_velocity: str = setting("gps", "Velocity the INS begins with.", choices=("gps", "zero"))
    velocity: str = setting("filtered", "Velocity given out: of the INS, or its offset taken out.", choices=("ins", "filtered"))
    r_accel_ft2: float = setting(1089.0, "R of the acceleration filter.", unit="ft^2/s^4", minimum=1e-6, maximum=1e9)
    r_position_ft2: float = setting(1089.0, "R of the position filter.", unit="ft^2", minimum=1e-6, maximum=1e9)
    q_accel_ft2: list = setting([9e-9, 9e-12, 0.002], "Q of the acceleration filter, x y z.", unit="ft^2/s^4", minimum=0.0, maximum=1e6)
    q_position_ft2: list = setting([0.009, 0.009, 0.9705], "Q of the position filter, N E D.", unit="ft^2", minimum=0.0, maximum=1e6)
    x0_ft: float = setting(1.0, "Initial state of both filters.", unit="ft", minimum=-1e6, maximum=1e6)
    p0_ft2: float = setting(999999.0, "Initial variance of both filters.", unit="ft^2", minimum=1e-6, maximum=1e12)
    stale_s: float = setting(2.0, "A fix older than this is none.", unit="s", minimum=0.1, maximum=60.0)
    watch: bool = setting(True, "Exclude GPS whose offset from the INS is implausible.")
    gate: GateSettings = group(GateSettings, recovery_s=60.0)


def cascade_blocks(settings: CascadeSettings) -> list[Block]:
    """Bias of acceleration in body axes and of position in n: random walks, whose steps are the filter's."""
    sigma = (math.sqrt(settings.p0_ft2) * FOOT,) * 3
    return [
        Block("accel_bias", tuple(f"accel_bias_{axis}_mps2" for axis in "xyz"), Kind.FREE, sigma, np.inf, (0.0,) * 3),
        Block("position_bias", tuple(f"position_bias_{axis}_m" for axis in AXES), Kind.FREE, sigma, np.inf, (0.0,) * 3),
    ]


def butterworth(cutoff_hz: float, step_s: float) -> np.ndarray:
    """Two second-order sections (2, 5), b0 b1 b2 a1 a2, of a fourth-order low-pass, by the bilinear transform with its corner warped."""
    w = math.tan(math.pi * cutoff_hz * step_s)
    rows = []
    for k in (1, 3):
        damping = 2.0 * math.cos(k * math.pi / 8.0) * w
        a0 = 1.0 + damping + w * w
        b = w * w / a0
        rows.append([b, 2.0 * b, b, 2.0 * (w * w - 1.0) / a0, (1.0 - damping + w * w) / a0])
    return np.array(rows)


class LowPass:
    """The filter running over vectors (3,), from rest; ``cutoff_hz`` 0 or beyond half the rate lets all pass."""

    def __init__(self, cutoff_hz: float, step_s: float) -> None:
        passes = cutoff_hz <= 0.0 or cutoff_hz * step_s >= 0.5
        self.sections = np.zeros((0, 5)) if passes else butterworth(cutoff_hz, step_s)
        self._state = np.zeros((len(self.sections), 2, 3))

    def __call__(self, value: np.ndarray) -> np.ndarray:
        """Take the next value; return the filtered one."""
        for (b0, b1, b2, a1, a2), state in zip(self.sections, self._state, strict=True):
            out = b0 * value + state[0]
            state[0], state[1] = b1 * value - a1 * out + state[1], b2 * value - a2 * out
            value = out
        return value


class FlatFrame:
    """Metres north, east, down from the first fix, by the cosine of its latitude: equations (1) and (2)."""

    def __init__(self, lat: float, lon: float, height: float, *, sphere: bool) -> None:
        meridian, normal = radii(lat)
        north, east = (SPHERE_M, SPHERE_M) if sphere else (meridian + height, normal + height)
        self.origin, self.scale = (lat, lon, height), (north, east * math.cos(lat))

    def to_ned(self, lat: float, lon: float, height: float) -> np.ndarray:
        """Metres (3,) of a place, rad, rad, m."""
        lat0, lon0, height0 = self.origin
        return np.array([(lat - lat0) * self.scale[0], wrap(lon - lon0) * self.scale[1], height0 - height])

    def from_ned(self, ned: np.ndarray) -> np.ndarray:
        """The place (3,): lat, lon [rad], height [m]."""
        lat0, lon0, height0 = self.origin
        return np.array([lat0 + ned[0] / self.scale[0], wrap(lon0 + ned[1] / self.scale[1]), height0 - ned[2]])


@dataclass(slots=True)
class Differences:
    """Positions differentiated twice: position, velocity, acceleration, filtered acceleration at the newest stamp."""

    low_pass: LowPass
    position: np.ndarray
    velocity: np.ndarray | None = None
    accel: np.ndarray | None = None
    filtered: np.ndarray | None = None
    is_running: bool = False

    def take(self, position: np.ndarray, dt: float) -> None:
        """Take the next position."""
        velocity, self.is_running = (position - self.position) / dt, True
        if self.velocity is not None:
            self.accel = (velocity - self.velocity) / dt
            self.filtered = self.low_pass(self.accel)
        self.position, self.velocity = position, velocity


class CascadeCore:
    """The inertial solution and both filters.

    Attributes
    ----------
    A : ndarray (3, 3)
        Columns position, velocity, acceleration of the INS, m NED from the origin.
    estimate, P : ndarray (6,), (6, 6)
        Bias of acceleration (body axes) and of position.
    nav : ndarray (6,)
        lat, lon [rad], height [m] of the integrated solution, its velocity [m/s].
    gps, ins : Differences or None
        Of the fixes, and of the INS at the stamps of the fixes.
    frame : FlatFrame
    spread, velocity_spread : ndarray (3,)
        Mean square of what the integrated position and velocity were off by GPS lately, m^2, (m/s)^2.
    """

    velocity_rows, ranging, history = None, None, None
    climbs_by_aids = False
    is_felt = True

    def __init__(self, settings: CascadeSettings, layout: Layout, timeout_s: float, coast: tuple[float, float], as_printed: bool) -> None:
        self.settings, self.layout, self.held, self._timeout_s = settings, layout, HeldReference(), timeout_s
        self.coast_bias, self.coast_density = coast
        self.sign = -1.0 if as_printed else 1.0
        self._thesis = settings.constants == "thesis"
        self.nav, self.A = np.zeros(6), np.zeros((3, 3))
        self._raw = np.zeros((3, 3))  # as A, no bias taken out: what z_a is differentiated from
        self.estimate, self.P = np.full(layout.size, settings.x0_ft * FOOT), layout.initial_covariance()
        self._accel, self._position = layout["accel_bias"], layout["position_bias"]
        self.t_ns, self.started, self.guard_actions = 0, False, 0
        self.frame = FlatFrame(0.0, 0.0, 0.0, sphere=self._thesis)
        self.gps: Differences | None = None
        self.ins: Differences | None = None
        self._free: Differences | None = None
        self.fix_ns: int | None = None
        self._sample_ns: int | None = None
        self._stepped_ns: int | None = None
        self.drift = np.zeros(3)
        self.spread, self.velocity_spread = np.full(3, settings.r_position_ft2 * FOOT**2), np.ones(3)
        self._used_ns = 0
        self._stated = np.zeros(3)  # variance of the last fix
        self._q = FOOT**2 * np.array([*settings.q_accel_ft2, *settings.q_position_ft2], dtype=float)

    # the inertial solution ---------------------------------------------------------------------------------------------------

    def start(self, t_ns: int, nav: np.ndarray) -> None:
        """Begin at a place and velocity (6,)."""
        self.frame = FlatFrame(nav[0], nav[1], nav[2], sphere=self._thesis)
        self.A[:, 1] = self._raw[:, 1] = nav[3:6] if self.settings.initial_velocity == "gps" else 0.0
        self.t_ns, self.started, self._used_ns = int(t_ns), True, int(t_ns)
        self._put_out()

    @property
    def gravity(self) -> float:
        """Gravity as it is taken off, m/s^2."""
        return FEET_PER_G * FOOT if self._thesis else float(gravity(self.frame.origin[0], self.frame.origin[2]))

    def C_nb(self) -> np.ndarray:
        """Rotation (3, 3) from b to n, of (7), (8)."""
        if not self._thesis:
            return quat_to_dcm(self.held.q_nb)
        roll, pitch, yaw = np.degrees(quat_to_euler(self.held.q_nb)) / DEGREES_PER_RADIAN
        return euler_to_dcm(roll, pitch, yaw)

    def measured(self) -> np.ndarray:
        """u (3,), m/s^2: acceleration as the unit gives it, in the sign of the equations."""
        unit = FEET_PER_G * FOOT / STANDARD_GRAVITY if self._thesis else 1.0
        return self.sign * unit * self.held.force_b

    def hold(self, sample: Attitude) -> None:
        """Hold a sample at whose stamp the mean is."""
        self.held.take_attitude(sample)
        C, fall = self.C_nb(), np.array([0.0, 0.0, self.sign * self.gravity])
        self.A[:, 2] = C @ (self.measured() - self.estimate[self._accel]) + fall
        self._raw[:, 2] = C @ self.measured() + fall

    def move(self, to_ns: int) -> None:
        """Move the INS on with the acceleration held: A <- A phi (13), (14)."""
        if to_ns <= self.t_ns:
            return
        dt = 1e-9 * (to_ns - self.t_ns)
        phi = np.array([[1.0, 0.0, 0.0], [dt, 1.0, 0.0], [0.5 * dt * dt, dt, 1.0]])
        self.A, self._raw = self.A @ phi, self._raw @ phi
        if self.timed_out(to_ns):
            self.A[:, 2] = self._raw[:, 2] = 0.0
        self.t_ns = to_ns
        self._put_out()

    def settle(self) -> None:
        """Nothing: both covariances step with the filters."""

    def _put_out(self) -> None:
        self.nav[0:3] = self.frame.from_ned(self.A[:, 0] - self.estimate[self._position])
        self.nav[3:6] = self.A[:, 1] - (self.drift if self.settings.velocity == "filtered" else 0.0)

    # GPS ---------------------------------------------------------------------------------------------------------------------

    def take_fix(self, fix: GpsPosition) -> None:
        """Differentiate a fix and the INS at its stamp, where the mean is."""
        place, since = self.frame.to_ned(fix.lat, fix.lon, fix.height), self.fix_ns
        self.fix_ns, self._stated = fix.stamp_ns, np.minimum(fix.cov_n.diagonal(), UNKNOWN_VARIANCE)
        dt = math.inf if since is None else 1e-9 * (fix.stamp_ns - since)
        if self.gps is None or self.ins is None or dt > HOLE_S:
            step = 1.0 if not math.isfinite(dt) or dt > HOLE_S else dt
            places = place, self.A[:, 0].copy(), self._raw[:, 0].copy()
            self.gps, self.ins, self._free = (Differences(LowPass(self.settings.cutoff_hz, step), p) for p in places)
            if since is None and self.settings.initial_velocity == "gps":  # known better than from the first difference
                self.gps.velocity, self.ins.velocity, self._free.velocity = (self.A[:, 1].copy() for _ in range(3))
        elif dt > 0.0 and self._free is not None:
            if not self.gps.is_running:  # the rate of the fixes is known with the second
                for differences in (self.gps, self._free):
                    differences.low_pass = LowPass(self.settings.cutoff_hz, dt)
            self.gps.take(place, dt)
            self.ins.take(self.A[:, 0].copy(), dt)
            self._free.take(self._raw[:, 0].copy(), dt)

    def follow_gps(self) -> None:
        """Let the INS be where GPS is: nothing carries it."""
        if self.gps is None:
            return
        self.A[:, 0] = self.gps.position + self.estimate[self._position]
        if self.gps.velocity is not None:
            self.A[:, 1], self.drift = self.gps.velocity, np.zeros(3)
        self._put_out()

    def forget_fixes(self) -> None:
        """Differentiate anew: what came was no fix."""
        self.gps = self.ins = None

    def is_stale(self, t_ns: int) -> bool:
        """Whether the last fix is too old."""
        return self.fix_ns is None or t_ns - self.fix_ns > 1e9 * self.settings.stale_s

    def accel_offset(self) -> np.ndarray | None:
        """z_a (3,), body axes, m/s^2; None while the fixes are too few."""
        if self.gps is None or self.gps.filtered is None:
            return None
        C = self.C_nb()
        if self.settings.match_delay and self._free is not None and self._free.filtered is not None:
            return C.T @ (self._free.filtered - self.gps.filtered)
        accel = self.gps.filtered.copy()
        accel[2] -= self.sign * self.gravity
        return self.measured() - C.T @ accel

    def position_offset(self) -> np.ndarray | None:
        """z_p (3,), m NED; None before the first fix."""
        if self.gps is None or self.ins is None or self.fix_ns is None:
            return None
        if self.settings.compare == "epoch":
            return self.ins.position - self.gps.position
        place = self.gps.position
        if self.settings.compare == "extrapolated" and self.gps.velocity is not None:
            place = place + self.gps.velocity * (1e-9 * (self.t_ns - self.fix_ns))
        return self.A[:, 0] - place

    # both filters ------------------------------------------------------------------------------------------------------------

    def step(self) -> float:
        """One step of both filters: M = P + Q (27); return what R is to be multiplied by."""
        since, self._stepped_ns = self._stepped_ns, self.t_ns
        steps = 1.0
        if self.settings.step_s > 0.0 and since is not None:
            steps = max(1e-9 * (self.t_ns - since), 1e-3) / self.settings.step_s
        self.P[np.diag_indices(len(self.P))] += self._q * steps
        return 1.0 / steps

    def correct(self, dx: np.ndarray) -> None:
        """Inject a correction (6,)."""
        self.estimate += dx
        self.P[:] = 0.5 * (self.P + self.P.T)
        self._put_out()

    def note(self, dt: float) -> None:
        """Note, at a fix that is used, what the integrated solution is off by, and how fast the position bias changes."""
        if self.gps is None or self.ins is None:
            return
        share = min(dt / MEMORY_S, 1.0)
        off = self.ins.position - self.estimate[self._position] - self.gps.position
        self.spread += share * (off**2 - self.spread)
        if self.gps.velocity is not None and self.ins.velocity is not None:
            self.drift += min(dt / SMOOTH_S, 1.0) * (self.ins.velocity - self.gps.velocity - self.drift)
            off = self.A[:, 1] - self.drift - self.gps.velocity
            self.velocity_spread += share * (off**2 - self.velocity_spread)
        self._used_ns = self.t_ns

    def restart_position(self) -> None:
        """Begin the position filter anew: P as at first."""
        for i in range(self._position.start, self._position.stop):
            self.P[i, i] = self.settings.p0_ft2 * FOOT**2

    def covariances(self) -> tuple[np.ndarray, np.ndarray]:
        """Covariances (3, 3) of position and velocity: off GPS as they have been lately, GPS off by what it states, grown since then."""
        t = 1e-9 * max(self.t_ns - self._used_ns, 0)
        velocity = self.velocity_spread + (self.coast_bias * t) ** 2 + self.coast_density * t
        ours = np.minimum(self.P.diagonal()[self._position], self.spread)
        grown = self.velocity_spread * t * t + (0.5 * self.coast_bias * t * t) ** 2 + self.coast_density * t**3 / 3.0
        if self.timed_out():
            grown, velocity = grown + 1e4 * t * t, velocity + 1e4
        return np.diag(self.spread + self._stated + ours + grown), np.diag(velocity + LEAST)

    def timed_out(self, t_ns: int | None = None) -> str:
        """Why nothing carries it now or at ``t_ns``, in words; empty when something does."""
        return self.held.timed_out(self.t_ns if t_ns is None else t_ns, self._timeout_s)

    def branch(self) -> "CascadeCore":
        """A copy that may be moved on alone."""
        twin = copy.copy(self)
        twin.A, twin.nav, twin.estimate, twin.P = self.A.copy(), self.nav.copy(), self.estimate.copy(), self.P.copy()
        twin._raw, twin.held = self._raw.copy(), copy.copy(self.held)
        return twin

    def motion(self) -> Motion:
        """Place, velocity and attitude with their covariance."""
        q_nb, cov_att = self.attitude()
        P = np.zeros((9, 9))
        P[0:3, 0:3], P[3:6, 3:6] = self.covariances()
        P[6:9, 6:9] = cov_att
        return Motion((self.nav[0], self.nav[1], self.nav[2]), self.nav[3:6].copy(), q_nb, P)

    def attitude(self) -> tuple[np.ndarray, np.ndarray]:
        """Attitude (4,) of the reference now and its covariance (3, 3)."""
        q_nb, swing = self.held.attitude(self.t_ns)
        return q_nb, self.held.cov_att + swing**2 * np.eye(3)

    def force_n(self) -> np.ndarray:
        """Specific force (3,) in n, m/s^2, the estimated bias taken out."""
        return self.sign * (self.C_nb() @ (self.measured() - self.estimate[self._accel]))

    def horizontal_sigma(self) -> float:
        """Estimated horizontal error, m."""
        cov = self.covariances()[0]
        return math.sqrt(cov[0, 0] + cov[1, 1])

    # views of aids -----------------------------------------------------------------------------------------------------------

    @property
    def speed_mps(self) -> float:
        """Speed over ground, m/s."""
        return float(np.linalg.norm(self.nav[3:6]))

    def lever_n(self, lever_b: np.ndarray) -> np.ndarray:
        """Lever arm (3,), m, turned to n."""
        return quat_rotate(self.held.q_nb, lever_b)

    def height_residual(self, height: float, bias: float) -> float:
        """A height, m, less the estimated one and an estimated bias."""
        return height - (self.nav[2] + bias)

    def velocity_at(self, lever_b: np.ndarray) -> str:
        """No aid of this core takes a velocity."""
        return "velocity is no state of the cascade"
