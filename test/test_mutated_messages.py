"""Some mutated messages into every navigator in flight; benchmarks/mutated_messages.py throws more of them."""

from collections import Counter

import mutated_messages as campaign
import pytest


@pytest.fixture(autouse=True, scope="module")
def short_way_to_the_copies():
    """The copies are taken after a minute with GPS, and 25 s after it was lost: the way there is not what is judged."""
    with pytest.MonkeyPatch.context() as patch:
        for name, seconds in {"GOOD_S": 60.0, "LOST_S": 70.0, "OUT_S": 95.0}.items():
            patch.setattr(campaign, name, seconds)
        yield
        campaign.flight_of.cache_clear()


def test_one_bad_message_is_refused_or_limited_alone():
    kinds = [kind for kind in campaign.MUTATIONS if kind != "stamps"]
    outcomes = campaign.campaign(204, 7, list(campaign.VARIANTS), kinds)
    harm = [o for o in outcomes if o.word in ("thrown", "restarted", "blinded", "unsound", "exception")]
    assert not harm
    counts = Counter(o.word for o in outcomes)
    assert counts["refused"] > 30
    assert counts["harmless"] > 30
    assert counts["shaken"] < 8


def test_the_campaign_sees_a_navigator_that_is_thrown(monkeypatch):
    """Without the screen of inertial samples spikes throw the solution, or the test above would show nothing."""
    screen = "lowcostnav_ros.estimation.inertial_spikes.InertialSpikes.screen"
    monkeypatch.setattr(screen, lambda self, block: iter([(None, block, "")]))
    outcomes = campaign.campaign(30, 7, ["ins_gps"], ["spikes"])
    words = Counter(o.word for o in outcomes)
    assert words["thrown"] + words["shaken"] > 3  # sources checked against each other bring it back sooner or later
