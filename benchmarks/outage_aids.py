"""What each aid of ins_gps buys in a GPS outage of one, two and five minutes: the same flights with and without it; prints JSON.

python benchmarks/outage_aids.py             # 40 flights of each kind
python benchmarks/outage_aids.py --table     # and the table of docs/ins_gps.md
"""

from argparse import Namespace

import numpy as np
from common import run
from outage_study import BARE, CASES, ENDS_S, outages_at_once

from lowcostnav_ros.studies.campaign import run_campaign
from lowcostnav_ros.studies.outages.result import End

FIRST_SEED = 501


def one_flight(seed: int) -> dict[str, tuple[End, ...]]:
    """Errors of every case on one aircraft flight and one drive."""
    return outages_at_once(list(CASES), seed)


def summary(ends: list[End]) -> dict[str, float]:
    """Median and 95th percentile over the flights; how the error compares with the sigma claimed (1.0 is honest)."""
    found = {}
    for name, key in (("horizontal_m", "horizontal_m"), ("height_m", "down_m"), ("heading_deg", "heading_deg")):
        values = [abs(getattr(end, key)) for end in ends]
        found[name] = {"median": round(float(np.median(values)), 2), "p95": round(float(np.percentile(values, 95)), 2)}
    found["error_over_sigma"] = round(float(np.sqrt(np.mean([end.error_over_sigma**2 for end in ends]))), 2)
    return found


def measure(options: Namespace) -> dict:
    """Fly, sum up."""
    seeds = list(range(FIRST_SEED, FIRST_SEED + (6 if options.quick else options.flights)))
    flights = run_campaign(one_flight, seeds, label="outages")
    cases = {name: {f"{end:.0f}_s": summary([f[name][i] for f in flights]) for i, end in enumerate(ENDS_S)} for name in CASES}
    if options.table:
        print(table(cases))
    return {"flights": len(seeds), "bare": BARE, "cases": cases}


def table(cases: dict) -> str:
    """Rows of the page: median / 95th percentile at the end of each outage."""
    columns = [("horizontal_m", end) for end in ("60_s", "120_s", "300_s")] + [("height_m", end) for end in ("60_s", "120_s")]
    rows = ["| aids | position 60 s | 120 s | 300 s | height 60 s | 120 s | heading 120 s | error over sigma 120 s |", "|---" * 8 + "|"]
    for name, case in cases.items():
        cells = [f"{case[end][what]['median']:.0f} / {case[end][what]['p95']:.0f} m" for what, end in columns]
        heading = case["120_s"]["heading_deg"]
        cells += [f"{heading['median']:.1f} / {heading['p95']:.1f}°", f"{case['120_s']['error_over_sigma']:.1f}"]
        rows.append(f"| {name.replace('_', ' ')} | {' | '.join(cells)} |")
    return "\n".join(rows)


if __name__ == "__main__":
    flights = {"type": int, "default": 40, "help": "flights of each kind"}
    run(__doc__.split("\n")[0], measure, flights=flights, table={"action": "store_true", "help": "print the table of the page first"})
