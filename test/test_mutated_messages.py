"""Some mutated messages into every navigator in flight; benchmarks/mutated_messages.py throws more of them."""

from collections import Counter

import mutated_messages as campaign


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
