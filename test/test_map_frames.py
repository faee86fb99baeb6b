"""Which origin an odometry belongs to: a stranger's, or that of a navigator that has been started again."""

import numpy as np
import pytest

from lowcostnav_ros.base.measurements import Health, NavSolution
from lowcostnav_ros.messages import encode, topics
from lowcostnav_ros.messages.decode import Decoder, Rejected
from lowcostnav_ros.messages.store import from_cdr, to_cdr
from lowcostnav_ros.physics.earth import LocalFrame, difference_n

OWN = LocalFrame(0.6578, -2.1262, 500.0)
VEL = np.array([50.0, 10.0, 0.0])


def solution(t_s):
    eye = np.eye(3)
    q = np.array([1.0, 0.0, 0.0, 0.0])
    place = OWN.from_ned(VEL * t_s)
    return NavSolution(round(1e9 * (1000.0 + t_s)), "ins_gps", *place, VEL, q, np.zeros(3), None, eye, eye, 1e-4 * eye)


def announce(decoder, origin, t_s):
    decoder.decode("ins_gps/origin", topics.NAV_SAT_FIX, to_cdr(encode.origin_fix(round(1e9 * (1000.0 + t_s)), origin)))


def heard(decoder, t_s, frame):
    """How far from the truth an odometry of this frame is taken to be, m."""
    sent = solution(t_s)
    back = decoder.decode("ins_gps/odometry", topics.ODOMETRY, to_cdr(encode.odometry_from_solution(sent, frame)))
    return float(np.linalg.norm(difference_n(*back.place, *sent.place)))


@pytest.mark.parametrize("offset", [(4000.0, -3800.0, 0.0), (0.0, 0.0, -2000.0), (20.0, 0.0, 0.0)])
def test_a_foreign_origin_does_not_move_the_solution(offset):
    decoder = Decoder()
    announce(decoder, OWN, 0.0)
    assert heard(decoder, 0.0, OWN) < 1e-6
    announce(decoder, LocalFrame(*OWN.from_ned(np.array(offset))), 5.0)
    assert max(heard(decoder, 0.1 * k, OWN) for k in range(1, 50)) < 1e-6


@pytest.mark.parametrize("offset", [(4000.0, -3800.0, 0.0), (0.0, 0.0, -300.0), (60.0, 5.0, 3.0)])
def test_the_origin_of_a_navigator_started_again_is_taken(offset):
    decoder, again = Decoder(), LocalFrame(*OWN.from_ned(np.array(offset)))
    announce(decoder, OWN, 0.0)
    heard(decoder, 0.0, OWN)
    announce(decoder, again, 5.0)
    assert heard(decoder, 0.1, OWN) < 1e-6  # what was still under way
    assert max(heard(decoder, 6.0 + 0.1 * k, again) for k in range(50)) < 1e-6


def test_the_first_origin_counts_while_there_is_no_track():
    decoder, later = Decoder(), LocalFrame(0.66, -2.1, 10.0)
    announce(decoder, OWN, 0.0)
    announce(decoder, later, 1.0)
    assert heard(decoder, 2.0, later) < 1e-6


def test_health_goes_through_its_message_and_what_is_none_is_refused():
    sent = Health(1_000_000_000, "ins_gps/health", "coasting", 1, "no GPS fix for 3 s", 2, 1)
    raw = to_cdr(encode.encode(sent))
    back = Decoder().decode("ins_gps/health", topics.DIAGNOSTICS, raw)
    assert (back.mode, back.level, back.reason, back.restarts, back.contradictions) == ("coasting", 1, "no GPS fix for 3 s", 2, 1)
    message = from_cdr(raw, topics.DIAGNOSTICS)
    for spoil in ({"level": 7}, {"message": ""}, {"values": []}):
        bad = from_cdr(raw, topics.DIAGNOSTICS)
        for name, value in spoil.items():
            setattr(bad.status[0], name, value)
        assert isinstance(Decoder().decode("ins_gps/health", topics.DIAGNOSTICS, to_cdr(bad)), Rejected)
    message.status.append(message.status[0])
    assert isinstance(Decoder().decode("ins_gps/health", topics.DIAGNOSTICS, to_cdr(message)), Rejected)
