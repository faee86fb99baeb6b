"""How the aircraft shakes: the spectrum of the specific force against time, and what stands out of it."""

import base64
import struct
import zlib
from pathlib import Path

import numpy as np

from lowcostnav_ros.base.measurements import ImuBlock
from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.report import svg
from lowcostnav_ros.report.chart import LEVELS, Frame, TimeAxis, grid
from lowcostnav_ros.report.document import section

SOURCE = "imu/data_raw"
SEGMENT, SLICES = 256, 180
"""Samples of a segment, and slices of the flight at most."""
FROM_HZ = 2.0
"""Below this it is the flight's own motion."""
LEAST_HZ, LEAST_S = 20.0, 20.0
SHADES = ("#081d58", "#225ea8", "#41b6c4", "#c7e9b4", "#ffffd9", "#fd8d3c", "#bd0026")
"""From quiet to loud."""
PEAKS, STANDS_OUT = 3, 4.0
"""Lines that are named, and how far above what is around them, in power."""


def spectrum(t_s: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Power spectral density of the specific force, the sum of its axes, in slices of time (Welch's method, Hann window).

    Segments overlap by half; one that has a gap in it is left out.

    Parameters
    ----------
    t_s : ndarray, shape (n,)
    force : ndarray, shape (n, 3)
        M/s^2.

    Returns
    -------
    starts_s : ndarray, shape (slices + 1,)
        Edges of the slices.
    hertz : ndarray, shape (SEGMENT // 2 + 1,)
    density : ndarray, shape (slices, SEGMENT // 2 + 1)
        (m/s^2)^2/Hz; NaN where a slice has no whole segment.
    """
    step_s = float(np.median(np.diff(t_s)))
    hertz, window = np.fft.rfftfreq(SEGMENT, step_s), np.hanning(SEGMENT)
    starts = np.arange(0, len(t_s) - SEGMENT + 1, SEGMENT // 2)
    starts = starts[np.abs((t_s[starts + SEGMENT - 1] - t_s[starts]) / ((SEGMENT - 1) * step_s) - 1.0) < 0.02]
    count = int(np.clip(len(starts) // 2, 1, SLICES))  # none is empty but where there is a gap
    edges = np.linspace(t_s[0], t_s[-1], count + 1)
    total, segments = np.zeros((count, len(hertz))), np.zeros(count)
    for start in starts:
        part = force[start : start + SEGMENT]
        power = np.abs(np.fft.rfft((part - part.mean(axis=0)) * window[:, None], axis=0)) ** 2
        at = min(int(np.searchsorted(edges, t_s[start + SEGMENT // 2], side="right")) - 1, count - 1)
        total[at] += 2.0 * step_s / np.sum(window**2) * power.sum(axis=1)
        segments[at] += 1
    with np.errstate(invalid="ignore"):
        return edges, hertz, total / np.where(segments, segments, np.nan)[:, None]


def vibration_section(bag: Path, axis: TimeAxis) -> str:
    """The section about a recording; an empty string without inertial samples that are fast enough."""
    with BagReader(bag) as reader:
        blocks = [m for m in reader.measurements([SOURCE] if SOURCE in reader.types else []) if isinstance(m, ImuBlock)]
    if not blocks:
        return ""
    t_s = np.concatenate([b.stamps_ns for b in blocks]) * 1e-9
    force = np.concatenate([b.specific_force_b for b in blocks])
    if len(t_s) < 2 * SEGMENT or t_s[-1] - t_s[0] < LEAST_S or 1.0 / np.median(np.diff(t_s)) < LEAST_HZ:
        return ""
    edges, hertz, density = spectrum(t_s, force)
    if not np.isfinite(density).any():
        return ""
    return section("Vibration", _picture(axis, edges, hertz, density), f'<p class="note">{svg.escape(_words(hertz, density))}</p>')


def _picture(axis: TimeAxis, edges: np.ndarray, hertz: np.ndarray, density: np.ndarray) -> str:
    frame = Frame(axis, 960, 220, 0.0, float(hertz[-1]))
    decibel = 10.0 * np.log10(np.maximum(density, 1e-12))
    low, high = np.nanpercentile(decibel[:, hertz >= FROM_HZ], [2.0, 99.7])
    shade = np.clip((decibel - low) / max(high - low, 1e-9) * 254.0, 0.0, 254.0)
    pixels = np.where(np.isfinite(decibel), shade, 255.0).astype(np.uint8).T[::-1]
    left, right = float(frame.x(edges[0])), float(frame.x(edges[-1]))
    look = {"preserveAspectRatio": "none", "style": "image-rendering:pixelated"}
    image = svg.element("image", href=_png(pixels), x=f"{left:.0f}", y=0, width=f"{right - left:.0f}", height=LEVELS, **look)
    two = "\N{SUPERSCRIPT TWO}"
    title = f"Spectrum of the specific force [Hz], from {low:.0f} (blue) to {high:.0f} dB (m/s{two}){two}/Hz (red)"
    under = svg.element("g", grid(frame), class_="axes")
    return frame.drawing(title, under, image, svg.text(2, 13, title, class_="title"), "Hz")


def _words(hertz: np.ndarray, density: np.ndarray) -> str:
    """RMS over the flight and the lines that stand out."""
    mean, step = np.nanmean(density, axis=0), hertz[1] - hertz[0]
    above = hertz >= FROM_HZ
    sentence = f"Above {FROM_HZ:g} Hz the specific force shakes by {np.sqrt(np.sum(mean[above]) * step):.2g} m/s\N{SUPERSCRIPT TWO} RMS"
    around = np.array([np.median(mean[max(k - 8, 0) : k + 9]) for k in range(len(mean))])
    inner = np.arange(1, len(mean) - 1)
    peaks = inner[(mean[inner] > mean[inner - 1]) & (mean[inner] >= mean[inner + 1]) & (mean[inner] > STANDS_OUT * around[inner])]
    peaks = sorted(peaks[above[peaks]], key=lambda k: -mean[k])[:PEAKS]
    lines = ", ".join(f"{hertz[k]:.1f} Hz ({np.sqrt(mean[k - 1 : k + 2].sum() * step):.2g})" for k in peaks)
    tail = f"; lines stand out at {lines}." if lines else "; no line stands out."
    return f"{sentence}{tail} What shakes faster than {hertz[-1]:.0f} Hz is folded into this by the sampling."


def _png(pixels: np.ndarray) -> str:
    """An image of shades 0 to 254, 255 clear, (rows, columns) of uint8, as an address that holds it."""
    stops = np.array([[int(c[k : k + 2], 16) for k in (1, 3, 5)] for c in SHADES])
    palette = np.array([np.interp(np.linspace(0, len(SHADES) - 1, 255), np.arange(len(SHADES)), stops[:, k]) for k in range(3)]).T
    palette = np.vstack([palette, [0, 0, 0]]).astype(np.uint8)

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    rows = b"".join(b"\0" + row.tobytes() for row in np.ascontiguousarray(pixels))
    head = struct.pack(">IIBBBBB", pixels.shape[1], pixels.shape[0], 8, 3, 0, 0, 0)
    clear = b"\xff" * 255 + b"\0"
    parts = (b"IHDR", head), (b"PLTE", palette.tobytes()), (b"tRNS", clear), (b"IDAT", zlib.compress(rows, 9)), (b"IEND", b"")
    return "data:image/png;base64," + base64.b64encode(b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*p) for p in parts)).decode()
