"""The few SVG elements the figures are made of, written compactly."""

import html
import math
from collections.abc import Iterable
from typing import Any

import numpy as np


def escape(text: object) -> str:
    """Text fit for HTML and SVG."""
    return html.escape(str(text), quote=True)


def element(name: str, content: str = "", **attributes: Any) -> str:
    """One element; an underscore in an attribute's name stands for a hyphen, a trailing one is dropped."""
    pairs = "".join(f' {key.rstrip("_").replace("_", "-")}="{escape(value)}"' for key, value in attributes.items() if value is not None)
    return f"<{name}{pairs}>{content}</{name}>" if content else f"<{name}{pairs}/>"


def text(x: float, y: float, content: str, **attributes: Any) -> str:
    """A text element."""
    return element("text", escape(content), x=f"{x:.1f}", y=f"{y:.1f}", **attributes)


def drawing(kind: str, label: str, width: int, height: int, content: str, **attributes: Any) -> str:
    """A whole drawing of ``width`` by ``height`` pixels, with a label for screen readers."""
    box: dict[str, Any] = {"viewBox": f"0 0 {width} {height}", "width": width, "height": height}
    return element("svg", content, class_=kind, role="img", aria_label=label, **box, **attributes)


def path_data(x: np.ndarray, y: np.ndarray, closed: bool = False) -> str:
    """Path of a curve of whole numbers, broken at NaN, in relative steps."""
    px, py = np.round(np.asarray(x)), np.round(np.asarray(y))
    finite = np.isfinite(px) & np.isfinite(py)
    out: list[str] = []
    last: tuple[int, int] | None = None
    for good, a, b in zip(finite.tolist(), px.tolist(), py.tolist(), strict=True):
        if not good:
            last = None
            continue
        point = (int(a), int(b))
        if last is None:
            out.append(f"M{point[0]} {point[1]}l")
        elif point != last:
            out.append(_pair(point[0] - last[0], point[1] - last[1]))
        last = point
    return _joined(out) + ("z" if closed and out else "")


def _pair(dx: int, dy: int) -> str:
    return f"{dx}{dy}" if dy < 0 else f"{dx} {dy}"


def _joined(parts: list[str]) -> str:
    out: list[str] = []
    for part in parts:
        if out and not out[-1].endswith("l") and part[0] not in "M-":
            out.append(" ")
        out.append(part)
    return "".join(out).replace("lM", "M").removesuffix("l")


def dots_data(x: np.ndarray, y: np.ndarray) -> str:
    """Path of separate dots (round caps of zero-length strokes), in relative steps."""
    finite = np.isfinite(x) & np.isfinite(y)
    px, py = (np.round(v[finite]).astype(int) for v in (x, y))
    steps = zip(np.diff(px, prepend=0).tolist(), np.diff(py, prepend=0).tolist(), strict=True)
    return "".join(f"m{_pair(dx, dy)}h0" for dx, dy in steps)


def path(data: str, **attributes: Any) -> str:
    """A path, not filled unless a colour says so, whose stroke is as wide as it says however its drawing is stretched."""
    return element("path", d=data, **{"fill": "none", **attributes}) if data else ""


def nice_ticks(low: float, high: float, count: int = 5) -> list[float]:
    """Round numbers between ``low`` and ``high`` in steps of 1, 2 or 5: as many as make at most ``count + 1`` spaces."""
    span = high - low
    if not (math.isfinite(span) and span > 0.0):
        return [low]
    power = 10.0 ** math.floor(math.log10(span / (count + 1)))
    step = next(s * power for s in (1.0, 2.0, 5.0, 10.0) if span / (s * power) <= count + 1)
    first = math.ceil(low / step - 1e-9)
    return [k * step for k in range(first, math.floor(high / step + 1e-9) + 1)]


def tick_label(value: float, ticks: Iterable[float]) -> str:
    """A tick's number with as many decimals as its neighbours need."""
    steps = sorted(set(ticks))
    step = min((b - a for a, b in zip(steps, steps[1:], strict=False)), default=abs(value) or 1.0)
    decimals = max(0, -math.floor(math.log10(step) + 1e-9)) if step > 0.0 else 0
    return f"{value + 0.0:.{min(decimals, 6)}f}".replace("-", "\N{MINUS SIGN}")
