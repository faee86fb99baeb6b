"""The carried core: position and velocity carried by the specific force and the attitude of a reference (AHRS), mean and covariance.

The reference keeps the attitude; what is wrong with it and with its accelerometers is a state.  With f = y - b its specific force in b,
C its attitude and g gravity in n (Njenga 2008, equations 9 to 16, with the rotation of the earth added)

    a = (I + [phi x]) C f + g - (2 w_e + w_t) x v,    dp/dt = v,    dv/dt = a

and for the errors, true less estimated, db = -b/tau_b + w, dphi = -phi/tau_phi + w,

    d(dp)/dt = dv,    d(dv)/dt = -C db - [C f x] dphi + w_a.
"""

import copy
import math
from dataclasses import dataclass, field, replace

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.measurements import Attitude, Measurement
from lowcostnav_ros.base.settings import setting
from lowcostnav_ros.base.small_matrices import matvec
from lowcostnav_ros.base.units import DEGREE, MILLI_G
from lowcostnav_ros.cores.bridging import UNKNOWN_ACCELERATION, accelerate
from lowcostnav_ros.cores.held import HeldAttitude, outdated
from lowcostnav_ros.cores.views import Motion, VelocitySeen
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.error_state import Block, Kind, Layout, gauss_markov
from lowcostnav_ros.physics.earth import displace, earth_rate_n, gravity, transport_rate_n
from lowcostnav_ros.physics.rotation import quat_apply_phi_n, quat_rotate, quat_to_dcm, skew

POS, VEL, CORE = slice(0, 3), slice(3, 6), 6
AXES = ("north", "east", "down")
LONGEST_STEP_S = 1.0
"""Samples farther apart than this are no samples of one motion."""
AT_REST = 1e-6
"""An acceleration below this, m/s^2, is none: the reference has no accelerometers, and gravity at its attitude stands in for them."""


@dataclass(frozen=True)
class CarriedSettings:
    """Errors of what carries position and velocity, as states of the filter ``joint``."""

    accel_bias_mg: float = setting(5.0, "Accelerometer bias, Gauss-Markov sigma.", unit="milli-g", minimum=0.01, maximum=1e3, within=3)
    accel_bias_tau_s: float = setting(1000.0, "Its correlation time.", unit="s", minimum=1.0, maximum=1e6)
    force_noise_mps2: float = setting(
        0.15, "White noise of one sample of acceleration, vibration included.", unit="m/s^2", minimum=1e-4, maximum=20.0, within=3
    )
    tilt_deg: float = setting(
        0.4, "Slow error of roll and pitch, sigma; 0: no attitude states (nine in all).", unit="deg", minimum=0.0, maximum=20.0, within=3
    )
    heading_deg: float = setting(1.5, "Slow error of the heading, sigma.", unit="deg", minimum=0.0, maximum=45.0, within=3)
    attitude_tau_s: float = setting(60.0, "Correlation time of the errors of attitude.", unit="s", minimum=1.0, maximum=1e5)
    timeout_s: float = setting(1.0, "Attitude older than this has timed out.", unit="s", minimum=0.05, maximum=30.0)


def carried_blocks(settings: CarriedSettings) -> list[Block]:
    """Position and velocity, accelerometer bias, errors of attitude where they are states: nine or twelve."""
    labels = (*(f"position_{axis}_m" for axis in AXES), *(f"velocity_{axis}_mps" for axis in AXES))
    bias = settings.accel_bias_mg * MILLI_G
    blocks = [
        Block("core", labels, Kind.CORE, (10.0,) * 3 + (1.0,) * 3, np.inf, (0.0,) * 6),
        gauss_markov("accel_bias", [f"accel_bias_{axis}_mps2" for axis in "xyz"], Kind.FREE, bias, settings.accel_bias_tau_s),
    ]
    if settings.tilt_deg > 0.0:
        sigmas = [s * DEGREE for s in (settings.tilt_deg, settings.tilt_deg, max(settings.heading_deg, settings.tilt_deg))]
        slow = [f"attitude_error_{axis}_rad" for axis in AXES]
        blocks.append(gauss_markov("attitude_error", slow, Kind.FREE, sigmas, settings.attitude_tau_s))
    return blocks


@kernel
def frame_acceleration(nav):
    """Gravity less Coriolis acceleration, shape (3,), m/s^2 NED, at ``nav``: lat, lon [rad], height [m], velocity NED [m/s]."""
    turn = 2.0 * earth_rate_n(nav[0]) + transport_rate_n(nav[0], nav[2], nav[3:6])
    out = -matvec(skew(turn), nav[3:6])
    out[2] += gravity(nav[0], nav[2])
    return out


@kernel
def carry(P, C, force_n, bias, tilt, rate, psd, accel_psd, dt):
    """Carry P over ``dt`` in place; ``bias``, ``tilt``: first rows of those states, no tilt -1; ``accel_psd`` (3,) of n."""
    n = P.shape[0]
    F, GQG, turned = np.zeros((n, n)), np.zeros((n, n)), skew(force_n)
    for i in range(n):
        F[i, i], GQG[i, i] = -rate[i], psd[i]
    for i in range(3):
        F[i, 3 + i] = 1.0
        GQG[3 + i, 3 + i] = accel_psd[i]
        for j in range(3):
            F[3 + i, bias + j] = -C[i, j]
            if tilt >= 0:
                F[3 + i, tilt + j] = -turned[i, j]
    kalman.predict_covariance(P, kalman.transition(F, dt), GQG, dt)


@dataclass(slots=True)
class HeldReference(HeldAttitude):
    """The last sample of the reference, its specific force with its sign put right."""

    force_b: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def timed_out(self, t_ns: int, limit_s: float) -> str:
        """Why there is nothing to be carried by, in words; empty when there is."""
        return outdated("attitude", self.attitude_ns, t_ns, limit_s)


class CarriedCore:
    """Mean and covariance of position, velocity and the errors of the reference that carries them.

    Attributes
    ----------
    nav : ndarray (6,)
        lat, lon [rad], height [m above the ellipsoid], velocity NED [m/s].
    estimate : ndarray (n,)
        Estimates of the states in ``layout``; the first six are unused (they live in ``nav``).
    P : ndarray (n, n)
    t_ns : int
        Time of the mean.
    held : HeldReference
    started : bool
    """

    velocity_rows, ranging, history = VEL, None, None
    climbs_by_aids = False

    def __init__(self, settings: CarriedSettings, layout: Layout) -> None:
        layout.forget()
        self.settings, self.layout, self.held = settings, layout, HeldReference()
        self.nav, self.estimate, self.P = np.zeros(6), np.zeros(layout.size), layout.initial_covariance()
        self.t_ns, self.started = 0, False
        self.guard_actions = 0
        self._accel_n: np.ndarray | None = None
        self._since_s, self._force_dt, self._period_s = 0.0, np.zeros(3), 0.0
        self._bias = layout["accel_bias"]
        self._tilt = layout.get("attitude_error")
        if self._tilt is not None:
            self.attitude_rows = self._tilt
        self._floor, self._ceiling = 1e-12 * np.maximum(layout.sigma0, 1e-9) ** 2, np.full(layout.size, 1e14)

    # time --------------------------------------------------------------------------------------------------------------------

    def start(self, t_ns: int, nav: np.ndarray, cov_pos: np.ndarray, cov_vel: np.ndarray) -> None:
        """Begin at a position and velocity (6,) with their covariances (3, 3)."""
        self.nav[:], self.t_ns, self.started = nav, int(t_ns), True
        kalman.reset_block(self.P, POS, cov_pos)
        kalman.reset_block(self.P, VEL, cov_vel)

    def hold(self, sample: Attitude) -> None:
        """Hold a sample at whose stamp the mean is; over the time since the last one the acceleration has changed linearly."""
        before, since = self._accel_n, self.held.attitude_ns
        if since is not None:
            self._period_s = min(max(1e-9 * (sample.stamp_ns - since), 0.0), LONGEST_STEP_S)
        self.held.take_attitude(sample)
        self._accel_n = self._acceleration()
        if self.started and before is not None and self._accel_n is not None and since is not None:
            dt = 1e-9 * (sample.stamp_ns - since)
            if 0.0 < dt <= LONGEST_STEP_S:
                change = self._accel_n - before
                self.nav[3:6] += change * (0.5 * dt)
                self.nav[0:3] = displace(self.nav[0], self.nav[1], self.nav[2], change * (dt * dt / 6.0))

    def _acceleration(self) -> np.ndarray | None:
        """Acceleration (3,) over ground in n without its Coriolis part, gravity included; None where the reference has none to give."""
        force_n = self.force_n()
        moving = np.linalg.norm(quat_rotate(self.held.q_nb, self.held.force_b) + [0.0, 0.0, np.linalg.norm(self.held.force_b)])
        return force_n if moving > AT_REST else None

    def force_n(self) -> np.ndarray:
        """Specific force (3,) in n, m/s^2, the estimated errors of the reference taken out."""
        force_n = quat_rotate(self.held.q_nb, self.held.force_b - self.estimate[self._bias])
        return force_n if self._tilt is None else force_n + np.cross(self.estimate[self._tilt], force_n)

    def move(self, to_ns: int) -> None:
        """Move the mean to ``to_ns`` with what is held; the covariance follows in :meth:`settle`."""
        if to_ns <= self.t_ns:
            return
        dt = 1e-9 * (to_ns - self.t_ns)
        carried = not self.timed_out(to_ns) and self._accel_n is not None
        accel_n = self._accel_n + frame_acceleration(self.nav) if carried and self._accel_n is not None else np.zeros(3)
        self.nav[0:3] = displace(self.nav[0], self.nav[1], self.nav[2], self.nav[3:6] * dt + accel_n * (0.5 * dt * dt))
        self.nav[3:6] += accel_n * dt
        self._since_s += dt
        if carried and self._accel_n is not None:
            self._force_dt += self._accel_n * dt
        else:
            accelerate(self.P, UNKNOWN_ACCELERATION, dt)  # what an aircraft may do while nothing tells
        self.t_ns = to_ns

    def settle(self) -> None:
        """Bring the covariance to the time of the mean."""
        dt = self._since_s
        if dt <= 0.0:
            return
        psd = self.layout.psd
        if self._tilt is not None:  # what the reference says of itself, where that is worse than set
            stated = self.held.cov_att.diagonal() / self.layout.sigma0[self._tilt] ** 2
            psd = psd.copy()
            psd[self._tilt] *= np.clip(stated, 1.0, 1e4)
        noise = self.settings.force_noise_mps2**2 * self._period_s
        tilt = -1 if self._tilt is None else self._tilt.start
        args = self.layout.rate, psd, np.full(3, noise), dt
        carry(self.P, quat_to_dcm(self.held.q_nb), self._force_dt / dt, self._bias.start, tilt, *args)
        self.estimate[CORE:] *= np.exp(-self.layout.rate[CORE:] * dt)
        self._since_s, self._force_dt = 0.0, np.zeros(3)

    def timed_out(self, t_ns: int | None = None) -> str:
        """Why nothing carries it now or at ``t_ns``, in words; empty when something does."""
        return self.held.timed_out(self.t_ns if t_ns is None else t_ns, self.settings.timeout_s)

    @property
    def is_felt(self) -> bool:
        """Whether the reference gives an acceleration at all."""
        return self._accel_n is not None

    def branch(self) -> "CarriedCore":
        """A copy that may be moved on alone."""
        twin = copy.copy(self)
        twin.P, twin.nav, twin.estimate, twin._force_dt = self.P.copy(), self.nav.copy(), self.estimate.copy(), self._force_dt.copy()
        twin.held = copy.copy(self.held)
        return twin

    def become(self, other: "CarriedCore") -> None:
        """Take over the state of another core of the same layout and time."""
        self.nav[:], self.estimate[:], self.P[:] = other.nav, other.estimate, other.P
        self.held, self._accel_n, self._period_s = copy.copy(other.held), other._accel_n, other._period_s
        self._since_s, self._force_dt = other._since_s, other._force_dt.copy()

    def fly(self, item: Measurement, until_ns: int, output_ns: int) -> bool:
        """Move to the stamp of what carries it and hold that, if it is no later than ``until_ns``; return whether it was."""
        if item.stamp_ns > until_ns:
            return False
        self.move(item.stamp_ns)
        self.settle()
        if isinstance(item, Attitude):
            self.hold(item)
        return True

    def arrive(self, t_ns: int) -> None:
        """Come to a time with what is held."""
        self.move(t_ns)
        self.settle()

    def motion(self) -> Motion:
        """Place, velocity and attitude with their covariance."""
        q_nb, cov_att = self.attitude()
        P = np.zeros((9, 9))
        P[0:6, 0:6], P[6:9, 6:9] = self.P[:CORE, :CORE], cov_att
        return Motion((self.nav[0], self.nav[1], self.nav[2]), self.nav[3:6].copy(), q_nb, P)

    def correct(self, dx: np.ndarray) -> None:
        """Inject a correction (n,): the estimate moves, the error state is zero again."""
        self.nav[0:3] = displace(self.nav[0], self.nav[1], self.nav[2], dx[POS])
        self.nav[3:6] += dx[VEL]
        self.estimate[CORE:] += dx[CORE:]
        if self._accel_n is not None:
            self._accel_n = self.force_n()
        self.guard_actions += kalman.guard_covariance(self.P, self._floor, self._ceiling)

    def attitude(self) -> tuple[np.ndarray, np.ndarray]:
        """Attitude (4,) now, the estimated error taken out, and its covariance (3, 3), rad^2."""
        q_nb, swing = self.held.attitude(self.t_ns)
        if self._tilt is None:
            return q_nb, self.held.cov_att + swing**2 * np.eye(3)
        return quat_apply_phi_n(q_nb, self.estimate[self._tilt]), self.P[self._tilt, self._tilt] + swing**2 * np.eye(3)

    def horizontal_sigma(self) -> float:
        """Estimated horizontal error, m: root of the sum of both variances."""
        return math.sqrt(max(self.P[0, 0] + self.P[1, 1], 0.0))

    def dynamics(self) -> np.ndarray:
        """Continuous error dynamics F (n, n)."""
        F = -np.diag(self.layout.rate)
        F[POS, VEL] = np.eye(3)
        F[VEL, self._bias] = -quat_to_dcm(self.held.q_nb)
        if self._tilt is not None:
            F[VEL, self._tilt] = -skew(self.force_n())
        return F

    # views of aids -----------------------------------------------------------------------------------------------------------

    @property
    def speed_mps(self) -> float:
        """Speed over ground, m/s."""
        return float(np.linalg.norm(self.nav[3:6]))

    def C_nb(self) -> np.ndarray:
        """Rotation (3, 3) from b to n."""
        return quat_to_dcm(self.attitude()[0])

    def lever_n(self, lever_b: np.ndarray) -> np.ndarray:
        """Lever arm (3,), m, turned to n."""
        return quat_rotate(self.attitude()[0], lever_b)

    def height_residual(self, height: float, bias: float) -> float:
        """A height, m, less the estimated one and an estimated bias."""
        return height - (self.nav[2] + bias)

    def velocity_at(self, lever_b: np.ndarray) -> VelocitySeen:
        """Velocity of an antenna: that of the reference and what the lever arm adds."""
        H = np.zeros((3, self.layout.size))
        H[:, VEL] = np.eye(3)
        swing_n = self.lever_n(np.cross(self.held.rate_b, lever_b)) if lever_b.any() else np.zeros(3)
        if self._tilt is not None:
            H[:, self._tilt] = -skew(swing_n)
        return VelocitySeen(self.nav[3:6], swing_n, H)


def sensed(sample: Attitude, sign: float) -> Attitude:
    """A sample with its accelerations as specific force: ``sign`` -1 for a unit that gives +1 g at rest on its down axis."""
    return sample if sign > 0.0 else replace(sample, specific_force_b=-sample.specific_force_b)
