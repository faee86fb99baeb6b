"""The pulse budget of Gebre-Egziabher 2004, section 2.5.5, and the schedules it allows."""

import pytest

from lowcostnav_ros.radionav import interrogation
from lowcostnav_ros.radionav.interrogation import InterrogationSchedule, ScheduleError


def test_published_budget_is_exact():
    assert interrogation.PULSES_PER_FIX == 565
    assert interrogation.FIXES_PER_STATION_PER_MINUTE == 2
    assert InterrogationSchedule("one_receiver", 2).interval_s == 15.0
    assert interrogation.transponder_load(tracking=95, searching=5) == 3050


def test_one_receiver_alternates_every_15_s():
    schedule = InterrogationSchedule()
    slots = [slot for turn in range(4) for slot in schedule.slots(turn)]
    assert [s.channel for s in slots] == [0, 1, 0, 1]
    assert [s.begin_s for s in slots] == [0.0, 15.0, 30.0, 45.0]
    assert {s.reply_s - s.begin_s for s in slots} == {5.0}
    assert 60.0 / (schedule.interval_s * schedule.stations) * interrogation.PULSES_PER_FIX == 2 * 565


def test_two_receivers_and_scanning_intervals():
    assert InterrogationSchedule("two_receivers").interval_s == 30.0
    assert InterrogationSchedule("scanning", 3).interval_s == 1.0
    assert interrogation.PULSES_PER_MINUTE == 1500


@pytest.mark.parametrize(
    ("scheme", "stations", "interval_s", "sentence"),
    [
        ("one_receiver", 2, 10.0, "interval of 10 s is over the pulse budget of 1500 pulses/min per station; use 15 s or longer"),
        ("one_receiver", 1, 15.0, "use 30 s or longer for one_receiver with 1 station."),
        ("one_receiver", 12, 4.0, "use 5 s or longer"),
        ("two_receivers", 2, 15.0, "use 30 s or longer"),
        ("two_receivers", 3, 30.0, "Two receivers ask two stations, not 3"),
        ("scanning", 2, 0.5, "use 1 s or longer"),
        ("one_receiver", 0, 15.0, "at least one station"),
        ("sweeping", 2, 15.0, "must be one of one_receiver, two_receivers, scanning, got 'sweeping'"),
    ],
)
def test_what_is_over_budget_is_refused(scheme, stations, interval_s, sentence):
    with pytest.raises(ScheduleError) as refusal:
        InterrogationSchedule(scheme, stations, interval_s)
    assert sentence in str(refusal.value)


def test_the_two_receivers_of_the_source_are_over_the_budget_and_say_so():
    schedule = InterrogationSchedule("two_receivers", 2, 15.0, over_budget=True)
    assert schedule.pulses_per_minute == 4 * 565
    assert schedule.saturation == "DME: 2260 pulses/min on each station, over the budget of 1500: 79 such aircraft saturate it."
    assert InterrogationSchedule("one_receiver", 2).saturation == InterrogationSchedule("scanning", 3).saturation == ""
    with pytest.raises(ScheduleError, match="over what a receiver can; use 5 s"):
        InterrogationSchedule("two_receivers", 2, 4.0, over_budget=True)


def test_a_station_answers_what_its_capacity_allows():
    assert interrogation.answered_share(3000.0) == 1.0
    assert interrogation.answered_share(4000.0) == 0.75
    assert interrogation.answered_share(0.0) == 1.0
