"""Made-up truth for the sensor tests: simple enough that what a perfect sensor would read is known by hand."""

import numpy as np

from lowcostnav_ros.base.truth import TruthBlock

START_NS = 1_780_000_000_000_000_000


def steady_truth(seconds, rate_hz=100, *, heading=0.0, speed=50.0, height=1000.0, wind=(0.0, 0.0, 0.0), lat_deg=37.69, lon_deg=-121.82):
    """Level flight at constant heading; east-west motion is left out of the position, which only the sensors' errors matter for."""
    n = round(seconds * rate_hz)
    ones = np.ones(n)
    vel_n = np.outer(ones, speed * np.array([np.cos(heading), np.sin(heading), 0.0]))
    q_nb = np.outer(ones, [np.cos(heading / 2), 0.0, 0.0, np.sin(heading / 2)])
    elapsed_s = np.arange(1, n + 1) / rate_hz
    return TruthBlock(
        START_NS + np.arange(1, n + 1) * (1_000_000_000 // rate_hz),
        np.radians(lat_deg) + vel_n[:, 0] * elapsed_s / 6.37e6,
        np.radians(lon_deg) + vel_n[:, 1] * elapsed_s / (6.37e6 * np.cos(np.radians(lat_deg))),
        height * ones,
        vel_n,
        q_nb,
        np.outer(ones, [0.0, 0.0, -9.80665]),
        np.outer(ones, [0.01, -0.02, 0.03]),
        np.outer(ones, wind),
    )


def cuts(truth, lengths):
    """Yield the truth in blocks whose lengths follow ``lengths`` over and over."""
    start, k = 0, 0
    while start < len(truth):
        yield truth[start : start + lengths[k % len(lengths)]]
        start, k = start + lengths[k % len(lengths)], k + 1


def flat(measurements):
    """All numbers of a list of measurements, for comparison to the bit; samples of inertial blocks one by one."""
    rows = []
    for m in measurements:
        if hasattr(m, "stamps_ns"):
            columns = m.stamps_ns.tolist(), m.specific_force_b.tolist(), m.angular_rate_b.tolist()
            rows += [(m.source, s, *f, *w) for s, f, w in zip(*columns, strict=True)]
        else:
            values = (getattr(m, name) for name in m.__dataclass_fields__)
            rows.append(tuple(tuple(np.ravel(v).tolist()) if isinstance(v, np.ndarray) else v for v in values))
    return rows
