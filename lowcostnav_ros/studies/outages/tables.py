"""A study of outages as tables."""

from lowcostnav_ros.base.tables import Column, Table, number, percent
from lowcostnav_ros.studies.outages.result import Flown, OutageStudy, Statistics

Row = tuple[Flown, Statistics]

_COLUMNS = (
    Column("navigator", lambda row: row[0].navigator, left=True),
    Column("settings", lambda row: row[0].settings, left=True),
    Column("length", lambda row: f"{row[1].length_s:g}", "s", "for\n"),
    Column("outages", lambda row: f"{row[1].windows}", short="n"),
    Column("median", lambda row: number(row[1].median_m), "m", "median\n"),
    Column("95 %", lambda row: number(row[1].p95_m), "m", "95 %\n"),
    Column("max", lambda row: number(row[1].max_m), "m", "max\n"),
    Column("within 0.5 NM", lambda row: percent(row[1].share_within_half_mile), "%", "within\n0.5 NM"),
    Column("error over sigma, RMS", lambda row: number(row[1].error_over_sigma_rms, 2), short="error /\nsigma"),
    Column("beyond 3 sigma", lambda row: percent(row[1].share_beyond_3_sigma), "%", "> 3\nsigma"),
    Column("vertical max", lambda row: number(row[1].vertical_max_m), "m", "vert\nmax"),
    Column("without a solution", lambda row: f"{row[1].silent}", short="silent"),
)


def outage_table(study: OutageStudy) -> Table:
    """Errors at the end of the outages, by navigator, settings and length."""
    rows: list[Row] = [(flown, s) for flown in study.flown for s in flown.statistics]
    return Table.of("Horizontal error at the end of the outages", _COLUMNS, rows, notes=tuple(notes(study)))


def notes(study: OutageStudy) -> list[str]:
    """What the numbers were formed of, in sentences."""
    lines = [f"GPS lost every {study.every_s:g} s: {', '.join(study.withheld)} withheld. Reference: {study.reference}."]
    if study.without_gps:
        lines.append(f"{len(study.without_gps)} starts left out, there was no GPS to lose.")
    return lines + [f"{name} not run: {reason}." for name, reason in study.left_out.items()]


def window_table(flown: Flown) -> Table:
    """Every outage of one navigator: where, errors at the ends, the parts of the longest."""
    ends = [(outage, max(outage.ends, key=lambda end: end.length_s)) for outage in flown.outages if outage.ends]
    names = list(dict.fromkeys(name for _, end in ends for name in end.parts_m))
    columns = [
        Column("loss at", lambda row: f"{row[0].after_s:.0f}", "s"),
        Column("length", lambda row: f"{row[1].length_s:g}", "s"),
        Column("error", lambda row: number(row[1].horizontal_m), "m"),
        Column("sigma", lambda row: number(row[1].sigma_m), "m"),
        Column("vertical", lambda row: number(row[1].down_m), "m down"),
        *(Column(name, lambda row, name=name: number(row[1].parts_m.get(name)), "m") for name in names),  # type: ignore[misc]
        Column("turned", lambda row: number(row[1].circumstances.get("turned_deg")), "deg"),
        Column("heading error", lambda row: number(row[1].circumstances.get("heading_error_deg")), "deg"),
        Column("wind change", lambda row: number(row[1].circumstances.get("wind_change_mps")), "m/s"),
    ]
    return Table.of(f"{flown.label}: every outage, at its longest, with the parts of its error", columns, ends)
