"""Writes config/background.npz, what the maps draw under a flight: coast lines of the world and its airports.

    python docs/make_background.py land-10m.json airports.csv LICENSE

The first is Natural Earth's 1:10 million land (public domain) as TopoJSON, of the npm package ``world-atlas``; the second the table of the
Python package ``airportsdata`` (MIT), with its licence, which travels inside the file.
"""

import csv
import json
import re
import sys
from pathlib import Path

import numpy as np

STEP_DEG = 0.002
FARTHEST = 30_000
"""From point to point, steps: 16 bits hold it."""
TOLERANCE = 0.006 / STEP_DEG
"""Points that lie closer to the line through those that are kept are left out, steps."""


def simplified(line: np.ndarray) -> np.ndarray:
    """A line, shape (n, 2), by the method of Douglas and Peucker."""
    keep, stack = np.zeros(len(line), dtype=bool), [(0, len(line) - 1)]
    keep[[0, -1]] = True
    while stack:
        a, b = stack.pop()
        if b - a < 2:
            continue
        along, off = line[b] - line[a], line[a + 1 : b] - line[a]
        length = float(np.hypot(*along))
        away = np.abs(off[:, 0] * along[1] - off[:, 1] * along[0]) / length if length else np.hypot(*off.T)
        k = int(np.argmax(away))
        if away[k] > TOLERANCE:
            keep[a + 1 + k] = True
            stack += [(a, a + 1 + k), (a + 1 + k, b)]
    return line[keep]


def coast(path: Path) -> dict[str, np.ndarray]:
    """Lengths of the lines, their first points, and the differences of the others, as (lat, lon) in steps."""
    found = json.loads(path.read_text())
    scale, origin = (np.array(found["transform"][key]) for key in ("scale", "translate"))
    lines = []
    for arc in found["arcs"]:
        degrees = (np.cumsum(np.array(arc, dtype=np.int64), axis=0) * scale + origin)[:, ::-1]
        line = np.round(simplified(degrees / STEP_DEG)).astype(np.int32)
        longest = np.abs(np.diff(line, axis=0)).max(axis=1)
        each = zip(line[:-1], line[1:], longest // FARTHEST + 1, strict=True)
        parts = [line[:1], *(a + (b - a) * np.arange(1, n + 1)[:, None] // n for a, b, n in each)]
        lines.append(np.concatenate(parts))
    steps = np.concatenate([np.diff(line, axis=0) for line in lines]).astype(np.int16)
    first = np.array([line[0] for line in lines], dtype=np.int32)
    return {"counts": np.array([len(line) for line in lines], dtype=np.int32), "first": first, "steps": steps}


def airports(path: Path) -> dict[str, np.ndarray]:
    """Places in steps, identifiers and names of the airports with a location indicator of four letters."""
    with path.open(newline="", encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if re.fullmatch("[A-Z]{4}", row["icao"])]
    place = np.array([[float(row["lat"]), float(row["lon"])] for row in rows]) / STEP_DEG
    names = "\n".join(row["name"].replace("\n", " ") for row in rows).encode()
    idents = np.array([row["icao"].encode() for row in rows])
    return {"airports": np.round(place).astype(np.int32), "idents": idents, "names": np.frombuffer(names, dtype=np.uint8)}


if __name__ == "__main__":
    land, table, licence = map(Path, sys.argv[1:])
    licences = np.frombuffer(b"Coast: Natural Earth, public domain. Airports: airportsdata.\n\n" + licence.read_bytes(), dtype=np.uint8)
    target = Path(__file__).resolve().parents[1] / "config" / "background.npz"
    np.savez_compressed(target, step_deg=STEP_DEG, licences=licences, **coast(land), **airports(table))
    print(f"{target}: {target.stat().st_size / 1e3:.0f} kB")
