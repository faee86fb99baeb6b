"""Figures of a plan of satellites in view: the sky with its tracks, satellites and dilutions over time, times in view."""

from typing import TYPE_CHECKING, Any

import numpy as np

from lowcostnav_ros.report.gnss.plan import GnssPlan

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HOUR_S = 3600.0


def draw_sky(figure: "Figure", plan: GnssPlan) -> None:
    """Tracks over the sky, coloured where the satellite is in view; grey: what mask and cliffs hide."""
    sky = plan.sky
    figure.set_size_inches(6.4, 6.6)
    ax: Any = figure.add_subplot(projection="polar")
    ax.set_theta_zero_location("N")
    ax.set_theta_direction(-1)
    around = np.linspace(0.0, 2.0 * np.pi, 361)
    ax.fill_between(around, 90.0 - np.degrees(plan.lowest(around)), 90.0, color="#c3ccd3", lw=0.0)
    for j, name in enumerate(sky.names):
        up = sky.elevation[:, j] >= 0.0
        if not up.any():
            continue
        radius = np.where(up, 90.0 - np.degrees(sky.elevation[:, j]), np.nan)
        colour = "#1f77b4" if name[0] == "G" else "#d95f02"
        azimuth = np.unwrap(sky.azimuth[:, j])  # without jumps, so that a track through north does not go round
        ax.plot(azimuth, radius, color="#8a8f94", lw=0.5)
        ax.plot(azimuth, np.where(sky.visible[:, j], radius, np.nan), color=colour, lw=1.1)
        first = int(np.flatnonzero(up)[0])
        ax.annotate(name, (azimuth[first], radius[first]), xytext=(2, 2), textcoords="offset points", fontsize=7)
    ax.set_rlim(0.0, 90.0)
    ax.set_rticks([0, 30, 60, 90], labels=["90", "60", "30", ""], fontsize=7)
    ax.set_thetagrids([0, 90, 180, 270], ["N", "E", "S", "W"])
    ax.set_title(f"{plan.title}\n{plan.view}", fontsize=9)


def draw_geometry(figure: "Figure", plan: GnssPlan) -> None:
    """Satellites in view and the dilutions over time; shaded: no good position."""
    sky = plan.sky
    figure.set_size_inches(9.0, 5.2)
    top, below = figure.subplots(2, 1, sharex=True)
    hours = sky.time_s / HOUR_S
    top.step(hours, sky.counts, where="post", color="#1f77b4", lw=1.3)
    top.axhline(4, color="k", lw=0.8, ls="--")
    top.set(ylabel="satellites in view", ylim=(0.0, None))
    top.set_title(f"{plan.title}\n{plan.view}", fontsize=9)
    for dop, colour in (("hdop", "#1f77b4"), ("vdop", "#d95f02"), ("pdop", "#2a9d5c")):
        values = sky.column(dop)
        below.step(hours, np.where(np.isfinite(values), values, np.nan), where="post", lw=1.2, color=colour, label=dop.upper())
    below.axhline(plan.pdop_limit, color="k", lw=0.8, ls="--")
    below.set(ylabel="dilution of precision", xlabel=f"hours from {plan.start:%Y-%m-%d %H:%M} UTC", ylim=(0.0, 2.0 * plan.pdop_limit))
    below.set_xlim(0.0, hours[-1])
    below.legend(fontsize=8, ncols=3, loc="upper right")
    for window in plan.windows:
        for ax in (top, below):
            ax.axvspan(window.start_s / HOUR_S, window.end_s / HOUR_S, color="#e6ebf0", lw=0.0)


def draw_satellites(figure: "Figure", plan: GnssPlan) -> None:
    """When each satellite is in view, without those that never are."""
    sky = plan.sky
    rows = np.flatnonzero(sky.visible.any(axis=0))
    figure.set_size_inches(9.0, 1.2 + 0.17 * len(rows))
    ax = figure.subplots()
    for row, j in enumerate(rows):
        seen = np.concatenate(([False], sky.visible[:, j], [False]))
        edges = np.flatnonzero(seen[1:] != seen[:-1])
        spans = [(sky.time_s[a] / HOUR_S, (b - a) * sky.step_s / HOUR_S) for a, b in zip(edges[0::2], edges[1::2], strict=True)]
        ax.broken_barh(spans, (row - 0.35, 0.7), color="#1f77b4" if sky.names[j][0] == "G" else "#d95f02")
    ax.set_yticks(range(len(rows)), [sky.names[j] for j in rows], fontsize=7)
    ax.set(xlim=(0.0, sky.time_s[-1] / HOUR_S), ylim=(len(rows) - 0.4, -0.6), xlabel=f"hours from {plan.start:%Y-%m-%d %H:%M} UTC")
    ax.set_title(f"in view: {plan.title}\n{plan.view}", fontsize=9)


FIGURES = {"sky.png": draw_sky, "geometry.png": draw_geometry, "satellites.png": draw_satellites}
