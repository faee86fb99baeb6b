"""How long a Monte Carlo of INS/GPS takes: 1000 flights of ten minutes, each with its own noise, through the campaign runner on all cores.

The filter and flight are those of estimator_throughput.py; a flight counts by the error at its end over its sigma.  The numbers (sha256)
are the same for any number of workers.
"""

import hashlib
import os
import time
from pathlib import Path

import numpy as np
from common import run
from estimator_throughput import PLAIN, flown, stream

from lowcostnav_ros.navigators.ins_gps import InsGps
from lowcostnav_ros.physics.earth import difference_n
from lowcostnav_ros.studies.campaign import run_campaign


def ended(case: tuple[int, int]) -> tuple[float, ...]:
    """Position error NED (3,) of one flight, seconds and seed, at its end, and its sigmas, m."""
    seconds, seed = case
    navigator = InsGps(PLAIN)
    last = navigator.feed_all(stream(seconds, seed))[-1]
    truth = flown(seconds)
    row = int(np.searchsorted(truth.stamps_ns, last.stamp_ns))
    error = difference_n(*last.place, truth.lat[row], truth.lon[row], truth.height[row])
    return (*error.tolist(), *np.sqrt(np.diag(last.place_cov)).tolist())


def measure(options) -> dict:
    """Fly all of them; tell how sure the filter was."""
    flights = options.flights or (8 if options.quick else 1000)
    cases = [(options.seconds, seed) for seed in range(flights)]
    began = time.perf_counter()
    found = np.array(run_campaign(ended, cases, options.workers, label=Path(__file__).stem))
    ratio = found[:, :3] / found[:, 3:]
    return {
        "flights": flights,
        "flight_s": options.seconds,
        "workers": options.workers or len(os.sched_getaffinity(0)),
        "wall_s": round(time.perf_counter() - began, 1),
        "error_over_sigma": round(float(np.sqrt(np.mean(ratio**2))), 3),
        "sha256": hashlib.sha256(found.tobytes()).hexdigest()[:16],
    }


if __name__ == "__main__":
    run(__doc__.splitlines()[0], measure, workers={"type": int}, flights={"type": int}, seconds={"type": int, "default": 600})
