"""The page of a tuning: the numbers before and after, and the outages that judge them."""

from lowcostnav_ros.report.document import document, html_table, section
from lowcostnav_ros.report.outages.page import outage_section
from lowcostnav_ros.report.svg import escape
from lowcostnav_ros.studies.tuning.study import Tuned, tuning_table


def tuning_page(tuned: Tuned) -> str:
    """The page as text."""
    learned, navigator = sum(tuned.learned()), tuned.source.navigator
    said = f"{learned} of {len(tuned.parameters)} numbers of {navigator} are told by the recordings. {tuned.verdict()}"
    head = f'<header><h1>{escape(f"{navigator} tuned")}</h1><div class="findings"><p>{escape(said)}</p></div></header>'
    outages = [outage_section(study) for study in tuned.outages]
    return document(f"{navigator} tuned", [head, section("Numbers", html_table(tuning_table(tuned))), *outages])
