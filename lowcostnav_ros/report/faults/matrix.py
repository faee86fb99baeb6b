"""The picture of the fault study: a line for each fault, a field for each navigator, coloured by the verdict."""

from collections.abc import Sequence

from lowcostnav_ros.base.tables import number
from lowcostnav_ros.report.svg import drawing, element, escape, text
from lowcostnav_ros.studies.faults.flight import CHAIN
from lowcostnav_ros.studies.faults.judge import Row, Verdict

COLOURS = {
    Verdict.HARMLESS: "#e6f2e8",
    Verdict.SOUND: "#86c793",
    Verdict.UNNAMED: "#f0dc8c",
    Verdict.FALSE_ALARM: "#e0915c",
    Verdict.SILENT: "#b9c4cd",
    Verdict.WRONG: "#d6544f",
    Verdict.CRASHED: "#6b1f1c",
}
DARK = (Verdict.WRONG, Verdict.CRASHED)
LINE, FIELD, NAMES, NAMED = 18, 92, 258, 60


def matrix(rows: Sequence[Row]) -> str:
    """Draw rows of one seed; a field holds what error over sigma does not exceed 99 % of the time, where that matters."""
    faults = list(dict.fromkeys(row.fault for row in rows))
    navigators = [name for name in CHAIN if any(row.navigator == name for row in rows)]
    parts = [text(NAMES + FIELD * (k + 0.5), 14, name, text_anchor="middle", class_="tick") for k, name in enumerate(navigators)]
    parts.append(text(NAMES + FIELD * len(navigators) + 6, 14, "named after", class_="tick"))
    for line, fault in enumerate(faults):
        y = 20 + LINE * line
        own = [row for row in rows if row.fault == fault]
        parts.append(text(0, y + 13, fault))
        parts += [_field(row, NAMES + FIELD * navigators.index(row.navigator), y) for row in own]
        soonest = min((row.named_s for row in own if row.named_s is not None), default=None)
        parts.append(text(NAMES + FIELD * len(navigators) + 6, y + 13, "never" if soonest is None else f"{number(soonest)} s"))
    width, height = NAMES + FIELD * len(navigators) + NAMED + 20, 24 + LINE * len(faults)
    return drawing("matrix", "Verdicts by fault and navigator", width, height, "".join(parts))


def _field(row: Row, x: float, y: float) -> str:
    sigmas = max(row.most_sigmas or 0.0, row.attitude_sigmas or 0.0)
    dark = row.verdict in DARK
    reported = row.sentence or "nothing was reported"
    title = element("title", escape(f"{row.navigator}: {row.verdict}. {reported}"))
    box = element("rect", title, x=x + 1, y=y + 1, width=FIELD - 2, height=LINE - 2, rx=2, fill=COLOURS[row.verdict])
    shown = number(sigmas) if dark and row.verdict != Verdict.CRASHED else str(row.verdict).split(",")[0]
    label = text(
        x + FIELD / 2, y + 13, shown, text_anchor="middle", pointer_events="none", style="fill:#fff;font-weight:600" if dark else None
    )
    return box + label


def legend() -> str:
    """What the colours mean."""
    inks = {v: "#fff" if v in DARK else "#1d252c" for v in COLOURS}
    styles = {v: f"background:{colour};color:{inks[v]};padding:1px 8px;margin-right:8px" for v, colour in COLOURS.items()}
    return element("p", "".join(element("span", escape(v), style=style) for v, style in styles.items()), class_="note")
