"""How large the position error of DME-aided dead reckoning becomes along a planned track, without flying it.

The navigator is the reduced-order one: position and wind, ranges one at a time, heading and airspeed errors and range biases unknown to
it and their ranges given a larger noise instead.  Two covariances are carried side by side: the one the navigator *estimates*, from its
four states, and the one to *expect*, the error of those same gains against the full error model with heading, airspeed and a bias per
station (Gebre-Egziabher 2004, section 6.5, equations (5.20)-(5.21) and (6.54), tables 6.1 and 7.1).

State of the expected error: [north, east, wind north, wind east, heading, airspeed, bias of each station], true minus estimated.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from lowcostnav_ros.base.units import DEGREE, NAUTICAL_MILE
from lowcostnav_ros.radionav.plan import Reply, Route

if TYPE_CHECKING:
    from filterpy.kalman import KalmanFilter

KNOWN = 4
HEADING, AIRSPEED, BIASES = 4, 5, 6


@dataclass(frozen=True)
class ErrorModel:
    """Error model: sigmas and correlation times of table 6.1, start of table 7.1, filter noise that stands for the range biases."""

    wind_mps: float = 5.0
    wind_tau_s: float = 400.0
    heading: float = 2.5 * DEGREE
    heading_tau_s: float = 120.0
    heading_noise: float = 0.8 * DEGREE
    airspeed_mps: float = 2.6
    airspeed_tau_s: float = 400.0
    bias_m: float = 0.17 * NAUTICAL_MILE
    bias_distance_m: float = 0.5 * NAUTICAL_MILE
    noise_m: float = 0.004 * NAUTICAL_MILE
    filter_range_m: float = math.hypot(0.17, 0.004) * NAUTICAL_MILE
    filter_walk: float = 0.5
    start_position_m: float = 2.0
    start_wind_mps: float = 5.0


@dataclass(frozen=True, slots=True, eq=False)
class AidedSigma:
    """Columns (n,) ``time_s`` and covariances (n, 2, 2), m^2 north east, ``estimated`` and ``expected``, just before a range is fused."""

    time_s: np.ndarray
    estimated: np.ndarray
    expected: np.ndarray

    def horizontal(self) -> np.ndarray:
        """Expected horizontal error, root of the trace, m, shape (n,)."""
        return np.sqrt(np.trace(self.expected, axis1=1, axis2=2))


def aided_sigma(route: Route, replies: Sequence[Reply], model: ErrorModel | None = None) -> AidedSigma:
    """Carry both covariances along a route.

    Parameters
    ----------
    route : Route
        GPS is lost at its first point; ranges are fused at the first point at or after their reply.
    replies : sequence of Reply
        Ranges in order of time; empty for pure dead reckoning.
    model : ErrorModel, optional
    """
    model = model or ErrorModel()
    idents = sorted({r.station for r in replies})
    navigator, full = _start(model, len(idents))
    estimated, expected = np.empty((len(route.time_s), 2, 2)), np.empty((len(route.time_s), 2, 2))
    waiting = list(replies)
    for k, time_s in enumerate(route.time_s):
        if k:
            dt = round(float(time_s - route.time_s[k - 1]), 6)
            navigator.predict(None, None, *_navigator_steps(model, dt))
            Phi, Qd = _full_steps(model, route.speed, round(float(route.course[k - 1]), 4), len(idents), dt)
            full = Phi @ full @ Phi.T + Qd
        estimated[k], expected[k] = navigator.P[:2, :2], full[:2, :2]
        while waiting and waiting[0].time_s <= time_s + 1e-6:
            reply = waiting.pop(0)
            full = _fuse(navigator, full, reply.direction, BIASES + idents.index(reply.station), model)
    return AidedSigma(route.time_s, estimated, expected)


def _start(model: ErrorModel, stations: int) -> "tuple[KalmanFilter, np.ndarray]":
    from filterpy.kalman import KalmanFilter  # not on import: it costs a command that shows its options a second

    known = [model.start_position_m] * 2 + [model.start_wind_mps] * 2
    full = [*known, model.heading, model.airspeed_mps] + [model.bias_m] * stations
    navigator = KalmanFilter(dim_x=KNOWN, dim_z=1)
    navigator.P, navigator.R = np.diag(np.square(known)), np.array([[model.filter_range_m**2]])
    return navigator, np.diag(np.square(full))


@lru_cache(maxsize=4096)
def _navigator_steps(model: ErrorModel, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Transition and process noise of the navigator's own four states."""
    from filterpy.common import van_loan_discretization

    F = np.zeros((KNOWN, KNOWN))
    F[0, 2] = F[1, 3] = 1.0
    F[2, 2] = F[3, 3] = -1.0 / model.wind_tau_s
    wind = model.wind_mps * math.sqrt(2.0 / model.wind_tau_s)
    return van_loan_discretization(F, np.diag([math.sqrt(model.filter_walk)] * 2 + [wind] * 2), dt)


@lru_cache(maxsize=4096)
def _full_steps(model: ErrorModel, speed: float, course: float, stations: int, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Transition and process noise of the full error model; white heading noise acts across the track (equations 5.20, 5.21)."""
    from filterpy.common import van_loan_discretization

    rates = np.array(
        [1.0 / model.wind_tau_s] * 2
        + [1.0 / model.heading_tau_s, 1.0 / model.airspeed_tau_s]
        + [speed / model.bias_distance_m] * stations
    )
    sigmas = np.array([model.wind_mps] * 2 + [model.heading, model.airspeed_mps] + [model.bias_m] * stations)
    c, s = math.cos(course), math.sin(course)
    F = np.diag(np.concatenate(([0.0, 0.0], -rates)))
    F[0, 2] = F[1, 3] = 1.0
    F[:2, HEADING], F[:2, AIRSPEED] = (-speed * s, speed * c), (c, s)
    G = np.diag(np.concatenate(([0.0, 0.0], np.sqrt(2.0 * rates) * sigmas)))
    G[:2, 0] = -speed * model.heading_noise * s, speed * model.heading_noise * c
    return van_loan_discretization(F, G, dt)


def _fuse(navigator: "KalmanFilter", full: np.ndarray, direction: np.ndarray, bias: int, model: ErrorModel) -> np.ndarray:
    """Update the estimated covariance; return the expected one after the same gain."""
    navigator.update(np.zeros((1, 1)), H=np.array([[*direction, 0.0, 0.0]]))
    gain, row = np.zeros(len(full)), np.zeros(len(full))
    gain[:KNOWN] = navigator.K[:, 0]
    row[:2], row[bias] = direction, 1.0
    keep = np.eye(len(full)) - np.outer(gain, row)
    return keep @ full @ keep.T + model.noise_m**2 * np.outer(gain, gain)
