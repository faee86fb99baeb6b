"""Where the error of an outage comes from: its parts, each integrated over the window and projected on the error at the end.

With a wind estimate the velocity is that of the air mass plus that through the air; the difference to the reference's is

    dv = dw + (da . u) u + (da - (da . u) u),    da = dv - dw,    u = (cos psi, sin psi) of the reference,

wind, airspeed and heading (with sideslip).  Without one it is carried by the accelerometers: the velocity error at the loss times the
time, the double integral of what a wrong heading makes of the horizontal acceleration, d(dv)/dt = dpsi (-a_E, a_N); the rest is tilt and
accelerometers.  What other aids corrected is in the rest, too.
"""

import numpy as np

from lowcostnav_ros.physics.rotation import wrap
from lowcostnav_ros.replay.columns import NavColumns


def parts_of(
    estimate: NavColumns, reference: NavColumns, at_loss: np.ndarray, at_end: np.ndarray
) -> tuple[dict[str, float], dict[str, float]]:
    """Parts of a horizontal error, and the circumstances.

    Parameters
    ----------
    estimate, reference : NavColumns
        At common stamps, from the loss to the end; the reference moves as the aircraft did.
    at_loss, at_end : ndarray, shape (2,)
        Position error at both ends, m north and east.

    Returns
    -------
    parts_m, circumstances : dict of str to float
        As :class:`.result.End` has them; empty where velocity or attitude is missing.
    """
    t_s = (estimate.stamps_ns - estimate.stamps_ns[:1]) * 1e-9
    velocity = (estimate.vel_n - reference.vel_n)[:, :2]
    heading, turned = reference.euler[:, 2], wrap(estimate.euler[:, 2] - reference.euler[:, 2])
    if len(t_s) < 2 or not (np.isfinite(velocity).all() and np.isfinite(turned).all()):
        return {}, {}
    wind = estimate.wind_n - reference.wind_n
    found = {"loss": at_loss}
    circumstances = {
        "turned_deg": float(np.degrees(np.abs(wrap(np.diff(heading))).sum())),
        "heading_error_deg": float(np.degrees(turned.mean())),
    }
    if np.isfinite(wind).all():
        along = np.column_stack([np.cos(heading), np.sin(heading)])
        forward = np.sum((velocity - wind) * along, axis=1)
        found["wind"] = _integral(wind, t_s)[-1]
        found["airspeed"] = _integral(forward[:, None] * along, t_s)[-1]
        found["heading"] = _integral(velocity - wind - forward[:, None] * along, t_s)[-1]
        circumstances["wind_change_mps"] = float(np.linalg.norm(reference.wind_n[-1] - reference.wind_n[0]))
        circumstances["airspeed_error_mps"] = float(forward.mean())
    else:
        rising = np.diff(t_s, prepend=-1.0) > 0.0  # a stamp that comes twice has no rate of its own
        slope = np.gradient(reference.vel_n[rising, :2], t_s[rising], axis=0) if rising.sum() > 1 else np.zeros((1, 2))
        acceleration = slope[np.cumsum(rising) - 1]
        rotated = turned[:, None] * np.column_stack([-acceleration[:, 1], acceleration[:, 0]])
        found["velocity"] = velocity[0] * t_s[-1]
        found["heading"] = _integral(_integral(rotated, t_s), t_s)[-1]
    found["rest"] = at_end - np.sum(list(found.values()), axis=0)
    direction = at_end / max(float(np.linalg.norm(at_end)), 1e-9)
    return {name: float(part @ direction) for name, part in found.items()}, circumstances


def _integral(values: np.ndarray, t_s: np.ndarray) -> np.ndarray:
    """Integral (n, 2) of values (n, 2) from the first time to each, by the trapezium rule."""
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(t_s)[:, None]
    return np.vstack([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
