"""Tables of the fault study, from its rows."""

from collections import Counter
from collections.abc import Sequence

from lowcostnav_ros.base.tables import Column, Table, number, percent
from lowcostnav_ros.simulation.fault import FAULTS
from lowcostnav_ros.studies.faults.flight import CHAIN
from lowcostnav_ros.studies.faults.judge import Row, Verdict

COLOURS = {Verdict.WRONG: "red", Verdict.CRASHED: "red", Verdict.SILENT: "yellow", Verdict.UNNAMED: "yellow", Verdict.FALSE_ALARM: "red"}
BAD = (Verdict.WRONG, Verdict.CRASHED, Verdict.FALSE_ALARM)


def summary_table(rows: Sequence[Row]) -> Table:
    """How many faults came to which verdict, by navigator."""
    counts = {name: Counter(row.verdict for row in rows if row.navigator == name) for name in CHAIN}
    lines = [(name, *(str(count[v] or "-") for v in Verdict), str(sum(count.values()))) for name, count in counts.items() if count]
    return Table.plain("Verdicts", ("navigator", *(str(v) for v in Verdict), "faults"), lines)


def row_table(title: str, rows: Sequence[Row]) -> Table:
    """One line for each fault and navigator."""
    columns = (
        Column("fault", lambda r: r.fault, left=True),
        Column("navigator", lambda r: r.navigator, left=True),
        Column("verdict", lambda r: str(r.verdict), left=True),
        Column("detected", lambda r: number(r.detected_s), "s", page_only=True),
        Column("named after", lambda r: number(r.named_s), "s", short="named"),
        Column("worst error", lambda r: number(r.worst_m), "m", short="worst"),
        Column("without the fault", lambda r: number(r.healthy_worst_m), "m", page_only=True),
        Column("worst error over sigma", lambda r: number(r.worst_sigmas), short="e/s"),
        Column("99 % of error over sigma", lambda r: number(r.most_sigmas), short="99 %"),
        Column("99 % of attitude over sigma", lambda r: number(r.attitude_sigmas), short="att."),
        Column("beyond 4 sigma", lambda r: percent(r.beyond), "%", short="> 4 s"),
        Column("recovered after", lambda r: number(r.recovered_s), "s", short="back"),
        Column("longest silence", lambda r: number(r.silent_s), "s", page_only=True),
        Column("wrongly suspected", lambda r: r.blamed, left=True, page_only=True),
        Column("reported", reported, left=True, page_only=True),
    )
    return Table.of(title, columns, rows, colours=tuple(COLOURS.get(row.verdict, "") for row in rows))


def reported(row: Row) -> str:
    """The sentence that named the source, or the first one."""
    return f"{row.named_by}: {row.sentence}" if row.named_by else row.sentence


def fault_table(names: Sequence[str]) -> Table:
    """What there is to inject."""
    columns = (
        Column("fault", lambda f: f.name, left=True),
        Column("from", lambda f: f"{f.start_s:.0f}", "s"),
        Column("to", lambda f: f"{f.end_s:.0f}" if f.end_s < 1e5 else "end", "s"),
        Column("falsifies", lambda f: ", ".join(f.sources) if len(f.sources) < 4 else "all", left=True),
        Column("imitates", lambda f: f.imitates, left=True),
    )
    return Table.of("Faults", columns, [FAULTS[name] for name in names])


def bad(rows: Sequence[Row]) -> list[Row]:
    """The rows that are wrong and sure, the worst first."""
    return sorted((row for row in rows if row.verdict in BAD), key=lambda row: -max(row.most_sigmas or 0.0, row.attitude_sigmas or 0.0))
