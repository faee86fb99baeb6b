"""Compiled dynamics of dead reckoning: the motion of the mean and the exact evolution of its error covariance.

Mean: position moves with the air-relative velocity plus wind, p' = R(psi) a (1 + s + b/V) + w, where ``a`` is the horizontal part of
C_nb v_b as measured, psi the heading error, s and b scale and bias of the airspeed.  psi holds a part in
proportion to the sine of the bank: what a compass makes of a vertical hard iron, and the sideslip of a turn.  Error state, true minus
estimated (Gebre-Egziabher (5.20)-(5.21), every further state a constant, a random walk or a Gauss-Markov process):

    d(dp_n)/dt = -a_e dpsi + a_n ds + a_n/V db + dw_n        d(dp_d)/dt = dv_d
    d(dp_e)/dt =  a_n dpsi + a_e ds + a_e/V db + dw_e

White heading noise acts like an instantaneous heading error, across the track; white airspeed noise along it.  Wind is a sum: a mean, a
slow variation and turbulence, the latter two along the way flown.
As all states but position are independent and linear, transition and process noise of a step have a closed form for any length.
"""

import math

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.small_matrices import matvec, turned
from lowcostnav_ros.estimation.error_state import Kind
from lowcostnav_ros.estimation.kalman import lead
from lowcostnav_ros.physics.earth import displace

CORE = 4
POS, CLIMB = slice(0, 3), 3
WIND, SCALE, BIAS, HEADING = int(Kind.WIND), int(Kind.AIRSPEED_SCALE), int(Kind.AIRSPEED_BIAS), int(Kind.HEADING_BIAS)
BANKED = int(Kind.HEADING_BANK)
SUMS = 8
"""Integrals that a step of the covariance needs (:func:`move`)."""
SHORT = 1.0e-2
"""Step over correlation time below which the closed forms lose digits and their series is used."""


@kernel
def sum_estimates(estimate, kind, axis, bank):
    """Sum the estimates by what they act on, shape (5,): wind north, wind east, heading error, airspeed scale, airspeed bias.

    ``bank`` is the sine of the bank.
    """
    total = np.zeros(5)
    for i in range(CORE, kind.shape[0]):
        if kind[i] == WIND:
            total[axis[i]] += estimate[i]
        elif kind[i] == SCALE:
            total[3] += estimate[i]
        elif kind[i] == BIAS:
            total[4] += estimate[i]
        elif kind[i] == HEADING:
            total[2] += estimate[i]
        elif kind[i] == BANKED:
            total[2] += bank * estimate[i]
    return total


@kernel
def sigmas_of_sums(P, kind, bank):
    """Sigmas (3,) of the sums of the heading errors, the airspeed scales and the airspeed biases."""
    out = np.zeros(3)
    for k, wanted in enumerate((HEADING, SCALE, BIAS)):
        weight = np.zeros(P.shape[0])
        for i in range(P.shape[0]):
            if kind[i] == wanted:
                weight[i] = 1.0
            elif kind[i] == BANKED and wanted == HEADING:
                weight[i] = bank
        out[k] = math.sqrt(max((weight * matvec(P, weight)).sum(), 0.0))
    return out


@kernel
def corrected_air(air_n, total):
    """Horizontal air-relative velocity (2,) with the estimated heading and airspeed errors of ``total`` taken out."""
    speed = math.hypot(air_n[0], air_n[1])
    factor = 1.0 + total[3] + (total[4] / speed if speed > 0.0 else 0.0)
    c, s = math.cos(total[2]), math.sin(total[2])
    return np.array([factor * (c * air_n[0] - s * air_n[1]), factor * (s * air_n[0] + c * air_n[1])])


@kernel
def move(nav, estimate, kind, axis, mean_rate, climb_rate, air_n, bank, airborne, dt, sums):
    """Move the mean over ``dt`` with a constant air-relative velocity; gather what the covariance needs.

    ``nav`` (3,): lat, lon, height, in place; the vertical velocity is ``estimate[3]``.  ``sums`` (8,): dt and the integrals of a_n, a_e,
    a_n^2, a_n a_e, a_e^2, airborne time and the sine of the ``bank``.
    """
    decay = -math.expm1(-climb_rate * dt) / climb_rate
    step = np.zeros(3)
    step[2] = estimate[3] * decay
    sums[0] += dt
    if airborne:
        total = sum_estimates(estimate, kind, axis, bank)
        a = corrected_air(air_n, total)
        step[0] = (a[0] + total[0]) * dt
        step[1] = (a[1] + total[1]) * dt
        sums[1] += a[0] * dt
        sums[2] += a[1] * dt
        sums[3] += a[0] * a[0] * dt
        sums[4] += a[0] * a[1] * dt
        sums[5] += a[1] * a[1] * dt
        sums[6] += dt
        sums[7] += bank * dt
    nav[0], nav[1], nav[2] = displace(nav[0], nav[1], nav[2], step)
    estimate[3] *= math.exp(-climb_rate * dt)
    for i in range(CORE, kind.shape[0]):
        if mean_rate[i] > 0.0:
            estimate[i] *= math.exp(-mean_rate[i] * dt)


@kernel
def coupling(a_n, a_e, bank, airborne, kind, axis):
    """How the states turn position (3, n), per second: rows of F for an air-relative velocity (a_n, a_e), equations of the module head."""
    n = kind.shape[0]
    G = np.zeros((3, n))
    G[2, 3] = 1.0
    speed = math.hypot(a_n, a_e)
    if airborne == 0.0 or speed == 0.0:
        return G
    for i in range(CORE, n):
        if kind[i] == WIND:
            G[axis[i], i] = airborne
        elif kind[i] == SCALE:
            G[0, i], G[1, i] = a_n, a_e
        elif kind[i] == BIAS:
            G[0, i], G[1, i] = airborne * a_n / speed, airborne * a_e / speed
        elif kind[i] == HEADING:
            G[0, i], G[1, i] = -a_e, a_n
        elif kind[i] == BANKED:
            G[0, i], G[1, i] = -bank * a_e, bank * a_n
    return G


@kernel
def gauss_markov_integrals(rate, dt):
    """Of a state decaying with ``rate`` over ``dt``: transition, its integral, and per unit of driving noise the variance of the state,
    of state with integral, and of the integral; exact, by series where the closed forms cancel."""
    x = rate * dt
    if x < SHORT:
        e1 = dt * (1.0 - x / 2.0 + x * x / 6.0 - x * x * x / 24.0)
        q_s = dt * (1.0 - x + 2.0 * x * x / 3.0 - x * x * x / 3.0)
        q_si = dt * dt * (0.5 - 0.5 * x + 7.0 * x * x / 24.0 - x * x * x / 8.0)
        q_i = dt * dt * dt * (1.0 / 3.0 - x / 4.0 + 7.0 * x * x / 60.0 - x * x * x / 24.0)
        return math.exp(-x), e1, q_s, q_si, q_i
    e1 = -math.expm1(-x) / rate
    q_s = -math.expm1(-2.0 * x) / (2.0 * rate)
    return math.exp(-x), e1, q_s, (e1 - q_s) / rate, (dt - 2.0 * e1 + q_s) / (rate * rate)


@kernel
def step_matrices(G, rate, psd, dt):
    """Exact transition Phi and process noise Qd, both (n, n), of a step with constant coupling ``G`` (3, n).

    Equal to van Loan's matrix exponential for this structure (states 3... are independent of each other and of position).
    """
    n = rate.shape[0]
    Phi = np.zeros((n, n))
    Qd = np.zeros((n, n))
    for r in range(3):
        Phi[r, r] = 1.0
    for i in range(3, n):
        e, e1, q_s, q_si, q_i = gauss_markov_integrals(rate[i], dt)
        Phi[i, i] = e
        Qd[i, i] = psd[i] * q_s
        for r in range(3):
            g = G[r, i]
            if g != 0.0:
                Phi[r, i] = g * e1
                Qd[r, i] = psd[i] * g * q_si
                Qd[i, r] = Qd[r, i]
                for c in range(3):
                    Qd[r, c] += psd[i] * g * G[c, i] * q_i
    return Phi, Qd


@kernel
def add_position_noise(Qd, sums, heading, airspeed, walk):
    """Add white noise on position to ``Qd``: heading (rad^2 s) across, airspeed (relative, m^2/s) along, ``walk`` (m^2/s) both ways."""
    nn, ne, ee = sums[3], sums[4], sums[5]
    square = nn + ee
    along = airspeed * sums[6] / square if square > 0.0 else 0.0
    Qd[0, 0] += heading * ee + along * nn + walk * sums[0]
    Qd[1, 1] += heading * nn + along * ee + walk * sums[0]
    Qd[0, 1] += (along - heading) * ne
    Qd[1, 0] += (along - heading) * ne


@kernel
def carry_covariance(P, sums, kind, axis, rate, psd, heading, airspeed, walk, track):
    """Carry P (n, n) in place over the interval gathered in ``sums`` and clear it; ``track``: see :func:`.kalman.lead`."""
    dt = sums[0]
    if dt <= 0.0:
        return
    G = coupling(sums[1] / dt, sums[2] / dt, sums[7] / dt, sums[6] / dt, kind, axis)
    Phi, Qd = step_matrices(G, rate, psd, dt)
    add_position_noise(Qd, sums, heading, airspeed, walk)
    lead(track, Phi)
    moved = turned(Phi, P) + Qd
    for i in range(P.shape[0]):
        for j in range(i + 1):
            value = 0.5 * (moved[i, j] + moved[j, i])
            P[i, j] = value
            P[j, i] = value
    sums[:] = 0.0


@kernel
def unmodelled_velocity(air_n, heading, airspeed):
    """Covariance (3, 3), (m/s)^2, of a velocity about the modelled one: ``airspeed`` m/s along, ``heading`` rad across."""
    out = np.zeros((3, 3))
    a_n, a_e = air_n[0], air_n[1]
    square = max(a_n * a_n + a_e * a_e, 1e-12)
    along, across = airspeed * airspeed / square, heading * heading
    out[0, 0] = along * a_n * a_n + across * a_e * a_e
    out[1, 1] = along * a_e * a_e + across * a_n * a_n
    out[0, 1] = (along - across) * a_n * a_e
    out[1, 0] = out[0, 1]
    return out
