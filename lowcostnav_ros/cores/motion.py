"""The motion core: position, velocity and, where modelled, acceleration as states driven by noise, without inertial sensors.

    PV:  dp/dt = v,  dv/dt = w                       velocity a random walk of density q_v, m^2/s^3
    PVA: dp/dt = v,  dv/dt = a,  da/dt = -a/T + w    acceleration Gauss-Markov of driving density q_a, m^2/s^5

Errors are metres north, east, down, true minus estimated, at the current place, where p' = v holds; the mean turns with n.
"""

import math

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.cores.inertial import POS, VEL
from lowcostnav_ros.cores.views import VelocitySeen
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.error_state import Kind, Layout
from lowcostnav_ros.estimation.smoothing import History
from lowcostnav_ros.physics.earth import displace, transport_rate_n

CHAIN = int(Kind.CHAIN)
STEP_S = 0.25
"""Longest step of a prediction."""


@kernel
def motion_dynamics(moving, kind, axis, rate):
    """Continuous dynamics F (n, n): the first ``moving`` states (6 or 9) are a chain, further ones decay or add up by their kind."""
    n = kind.shape[0]
    F = np.zeros((n, n))
    for i in range(moving - 3):
        F[i, i + 3] = 1.0
    for i in range(6, n):
        F[i, i] = -rate[i]
        if kind[i] == CHAIN and axis[i] > 0:
            F[i - 1, i] = 1.0
    return F


@kernel
def predict(nav, estimate, P, moving, kind, axis, rate, psd, dt, track):
    """Carry mean and covariance over ``dt`` s, in place, in steps of at most :data:`STEP_S`; ``track``: see :func:`.kalman.lead`."""
    n = P.shape[0]
    steps = max(1, math.ceil(dt / STEP_S - 1e-9))
    h = dt / steps
    F = motion_dynamics(moving, kind, axis, rate)
    Phi, Phi_half = kalman.transition(F, h), kalman.transition(F, 0.5 * h)
    GQG = np.zeros((n, n))
    for i in range(n):
        GQG[i, i] = psd[i]
    for _ in range(steps):
        acceleration = estimate[6:9].copy() if moving == 9 else np.zeros(3)
        turn = transport_rate_n(nav[0], nav[2], nav[3:6])
        v0 = nav[3:6].copy()
        nav[3] += h * (acceleration[0] - turn[1] * v0[2] + turn[2] * v0[1])
        nav[4] += h * (acceleration[1] - turn[2] * v0[0] + turn[0] * v0[2])
        nav[5] += h * (acceleration[2] - turn[0] * v0[1] + turn[1] * v0[0])
        nav[0], nav[1], nav[2] = displace(nav[0], nav[1], nav[2], 0.5 * h * (v0 + nav[3:6]))
        for i in range(6, n):
            if rate[i] > 0.0:
                estimate[i] *= math.exp(-rate[i] * h)
            if kind[i] == CHAIN and axis[i] > 0:
                estimate[i - 1] += estimate[i] * h
        kalman.predict_covariance_by_simpson(P, Phi, Phi_half, GQG, h)
        kalman.lead(track, Phi)


class MotionCore:
    """Mean and covariance of the filter, in the form the satellite aids expect of an inertial core.

    ``nav`` (10,): lat, lon [rad], height [m], velocity NED [m/s], an unused level attitude; ``estimate`` (n,): acceleration and clock.
    """

    velocity_rows = VEL
    ranging = None
    history: History | None = None

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self.nav = np.array([0.0] * 6 + [1.0, 0.0, 0.0, 0.0])
        self.estimate = np.zeros(layout.size)
        self.P = layout.initial_covariance()
        self.t_ns = 0
        self._model = (9 if "acceleration" in layout else 6, layout.kind, layout.axis, layout.rate, layout.psd)

    def start(
        self,
        t_ns: int,
        place: tuple[float, float, float],
        vel_n: np.ndarray,
        cov_pos: np.ndarray | None = None,
        cov_vel: np.ndarray | None = None,
    ) -> None:
        """Begin at a place (rad, rad, m) and velocity; initial covariances and those of the two add up."""
        self.t_ns = int(t_ns)
        self.nav[:3], self.nav[3:6] = place, vel_n
        self.estimate[:] = 0.0
        self.P = self.layout.initial_covariance()
        for rows, covariance in ((POS, cov_pos), (VEL, cov_vel)):
            if covariance is not None:
                self.P[rows, rows] += covariance

    def advance(self, t_ns: int) -> None:
        """Predict to a stamp."""
        if self.layout.is_paced:
            self.layout.pace(self.speed_mps)
        track = kalman.NO_TRACK if self.history is None else self.history.begin(self.P)
        predict(self.nav, self.estimate, self.P, *self._model, 1e-9 * (t_ns - self.t_ns), track)
        self.t_ns = int(t_ns)
        if self.history is not None:
            self.history.end(self.P)

    def ahead(self, t_ns: int) -> tuple[np.ndarray, np.ndarray]:
        """Mean and covariance at a later stamp, leaving this state alone."""
        nav, P = self.nav.copy(), self.P.copy()
        if t_ns > self.t_ns:
            predict(nav, self.estimate.copy(), P, *self._model, 1e-9 * (t_ns - self.t_ns), kalman.NO_TRACK)
        return nav, P

    def correct(self, dx: np.ndarray) -> None:
        """Inject a correction (n,)."""
        nav = self.nav
        nav[0], nav[1], nav[2] = displace(nav[0], nav[1], nav[2], dx[POS])
        nav[3:6] += dx[VEL]
        self.estimate[6:] += dx[6:]
        if self.history is not None:
            self.history.correct(dx)

    def dynamics(self) -> np.ndarray:
        """Continuous dynamics F (n, n)."""
        return motion_dynamics(*self._model[:-1])

    def output_rows(self) -> dict[str, np.ndarray]:
        """Quantities of a solution by the error states, (m, n) each, for the smoother."""
        states = np.eye(self.layout.size)
        return {"pos": states[POS], "vel": states[VEL]}

    # views of aids -----------------------------------------------------------------------------------------------------------

    @property
    def speed_mps(self) -> float:
        """Speed over ground, m/s."""
        return float(np.hypot(self.nav[3], self.nav[4]))

    def lever_n(self, lever_b: np.ndarray) -> np.ndarray:
        """Zero: without an attitude the antenna is the aircraft."""
        return np.zeros(3)

    def height_residual(self, height: float, bias: float) -> float:
        """A height, m, less the estimated one and an estimated bias."""
        return height - self.nav[2] - bias

    def velocity_at(self, lever_b: np.ndarray) -> VelocitySeen | str:
        """The velocity, a state of its own."""
        H = np.zeros((3, self.layout.size))
        H[:, VEL] = np.eye(3)
        return VelocitySeen(self.nav[3:6], np.zeros(3), H)
