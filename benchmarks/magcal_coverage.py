"""Does the sigma of a magnetometer calibration cover its error?  Random partial clouds of field directions; prints JSON.

    python benchmarks/magcal_coverage.py            # 1000 clouds
    python benchmarks/magcal_coverage.py --quick    # 100

Each cloud: hard iron of 20 uT in each axis, one third without factors and cross terms, one third with factors of 3 %, one third with cross
terms of 2 % as well; a turn of 90 to 360 degrees with 5 to 90 degrees of tilt across it; noise of 0.05 to 0.5 uT; 5 % outliers in half of
them.  Every fit that is not refused counts.
"""

from argparse import Namespace

import numpy as np
from common import run

from lowcostnav_ros.calibration.magnetometer_full import full_fit
from lowcostnav_ros.calibration.record import CalibrationError
from lowcostnav_ros.studies.campaign import run_campaign

STRENGTH_UT, SAMPLES = 48.0, 400


def cloud(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Measured field (n, 3), uT, true hard iron (3,) and true matrix (3, 3) of a calibration."""
    rng = np.random.default_rng(seed)
    kind = seed % 3
    soft = np.diag(1.0 + (0.03 if kind else 0.0) * rng.standard_normal(3))
    if kind == 2:
        upper = np.triu(0.02 * rng.standard_normal((3, 3)), 1)
        soft = soft + upper + upper.T
    hard_iron = 20.0 * rng.standard_normal(3)
    turn, tilt = np.radians(rng.uniform(90.0, 360.0)), np.radians(rng.uniform(5.0, 90.0))
    azimuth, across = rng.uniform(0.0, turn, SAMPLES), rng.uniform(-0.5 * tilt, 0.5 * tilt, SAMPLES)
    strip = np.column_stack((np.cos(across) * np.cos(azimuth), np.cos(across) * np.sin(azimuth), np.sin(across)))
    q, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    measured = STRENGTH_UT * strip @ q.T @ soft + hard_iron + 10.0 ** rng.uniform(-1.3, -0.3) * rng.standard_normal((SAMPLES, 3))
    if rng.random() < 0.5:
        wrong = rng.choice(SAMPLES, SAMPLES // 20, replace=False)
        measured[wrong] += rng.uniform(-30.0, 30.0, (len(wrong), 3))
    return measured, hard_iron, np.linalg.inv(soft)


def judged(seed: int) -> dict[str, list[float]] | None:
    """Errors over sigmas, and the largest error over the sphere, uT; None where the fit was refused."""
    measured, hard_iron, matrix = cloud(seed)
    try:
        fit = full_fit(measured, STRENGTH_UT)
    except CalibrationError:
        return None
    factors, off = np.diag(fit.matrix - matrix), (fit.matrix - matrix)[[1, 0, 0], [2, 2, 1]]
    known = fit.cross_sigma > 0.0
    return {
        "hard_iron": list((fit.hard_iron - hard_iron) / fit.hard_iron_sigma),
        "factor": list(factors / fit.scale_sigma),
        "cross": list(off[known] / fit.cross_sigma[known]),
        "error_ut": [float(np.abs(fit.hard_iron - hard_iron).max())],
    }


def measure(options: Namespace) -> dict:
    """Fit all clouds, sum up."""
    found = run_campaign(judged, list(range(100 if options.quick else 1000)), label="clouds")
    made = [fit for fit in found if fit is not None]
    result: dict = {"clouds": len(found), "refused": len(found) - len(made)}
    for name in ("hard_iron", "factor", "cross"):
        ratio = np.abs(np.concatenate([fit[name] for fit in made]))
        shares = {f"within_{k}_sigma": round(float(np.mean(ratio < k)), 4) for k in (1, 2, 3)}
        result[name] = {**shares, "rms": round(float(np.sqrt(np.mean(ratio**2))), 2), "worst": round(float(ratio.max()), 1)}
    errors = np.concatenate([fit["error_ut"] for fit in made])
    result["hard_iron_error_ut"] = {"median": round(float(np.median(errors)), 2), "p95": round(float(np.percentile(errors, 95)), 2)}
    return result


if __name__ == "__main__":
    run(__doc__.splitlines()[0], measure)
