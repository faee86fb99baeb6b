"""Rate, age, gaps, silence of an input, on a clock the test turns."""

from hypothesis import given
from hypothesis import strategies as st

from lowcostnav_ros.ros.input_monitor import ERROR, OK, WARN, InputMonitor


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


def fed(rate_hz: float, count: int, **kwargs) -> tuple[InputMonitor, Clock]:
    clock = Clock()
    monitor = InputMonitor("imu/data_raw", clock=clock, **kwargs)
    for k in range(count):
        clock.now = 100.0 + k / rate_hz
        monitor.arrived()
        monitor.stamped(round(1e9 * (1000.0 + k / rate_hz)))
    return monitor, clock


def test_rate_and_count():
    monitor, _ = fed(100.0, 500)
    status = monitor.status("ins_gps")
    assert status.name == "ins_gps: input imu/data_raw" and status.level == OK
    assert status.values["rate_hz"] == "100.0" and status.values["count"] == "500" and status.values["gaps"] == "0"


def test_a_silent_sensor_is_named_with_its_silence_and_is_an_error_only_where_it_is_required():
    for required, level in ((True, ERROR), (False, WARN)):
        monitor, clock = fed(100.0, 50, required=required)
        clock.now += 0.9
        assert monitor.status("n").level == OK
        clock.now += 1.2
        assert monitor.status("n")[1:3] == (level, "imu/data_raw timed out: no data for 2.1 s")


def test_a_slow_sensor_is_given_five_of_its_intervals():
    monitor, clock = fed(1.0, 20)
    clock.now += 4.9
    assert monitor.status("n").level == OK
    clock.now += 0.2
    assert monitor.status("n").level == WARN


def test_an_input_that_never_came_is_named_after_two_seconds():
    clock = Clock()
    monitor = InputMonitor("gps/fix", True, clock=clock)
    assert monitor.status("n").level == OK
    clock.now += 2.5
    assert monitor.status("n")[1:3] == (ERROR, "gps/fix: nothing received yet after 2.5 s")


def test_rejections_are_counted_by_reason_and_colour_the_status_for_a_while():
    monitor, clock = fed(10.0, 10)
    monitor.reject("no fix")
    monitor.reject("no fix")
    monitor.reject("wrong frame id")
    status = monitor.status("n")
    assert status.level == WARN and "wrong frame id (3 rejected of 10)" in status.message
    assert status.values["rejected[no fix]"] == "2" and status.values["last_reject"] == "wrong frame id"
    for _ in range(60):
        clock.now += 0.1
        monitor.arrived()
    assert monitor.status("n").level == OK


@given(lost=st.sets(st.integers(10, 180), max_size=40), jitter=st.floats(0.0, 0.2))
def test_gaps_equal_the_samples_that_are_missing(lost, jitter):
    monitor = InputMonitor("imu/data_raw", clock=Clock())
    for k in range(200):
        if k not in lost:
            monitor.stamped(round(1e7 * (k + jitter * (k % 2))) + 10**18)
    assert monitor.gaps == len(lost) and monitor.backward == 0


def test_stamps_that_step_back_are_counted():
    monitor, _ = fed(100.0, 10)
    monitor.stamped(10**9)
    assert monitor.backward == 1


def test_an_input_whose_messages_are_all_refused_later_on_is_not_well():
    for required, level in ((True, ERROR), (False, WARN)):
        monitor, clock = fed(10.0, 50, required=required)
        monitor.refused(50, 0, "")
        assert monitor.status("n").level == OK
        monitor.refused(60, 9, "late")
        assert monitor.status("n")[1:3] == (level, "imu/data_raw: 9 of the last 10 refused: late")
        monitor.refused(60, 9, "late")
        assert monitor.status("n").level == level
        monitor.refused(70, 10, "late")
        assert monitor.status("n").level == OK


def test_a_flood_is_named_and_what_is_beyond_a_processes_means_is_shed():
    monitor, clock = fed(100.0, 2000, sheds=True)
    for _ in range(40):
        clock.now += 0.5
        monitor.status("n")
        for _ in range(50):
            clock.now += 0.01
            assert monitor.arrived()
    monitor.status("n")
    handled = 0
    for _ in range(10_000):
        clock.now += 1.0 / 5000.0
        handled += monitor.arrived()
    status = monitor.status("n")
    assert 6000 < handled < 7200 and monitor.rejected["flood"] == 10_000 - handled
    assert status.level == WARN and "flood: 5000 Hz" in status.message and "shed" in status.message
    lossless, clock = fed(100.0, 10)
    assert all(lossless.arrived() for _ in range(5000))


def test_an_input_that_starts_a_minute_after_its_node_is_no_flood():
    clock = Clock()
    monitor = InputMonitor("imu/data_raw", clock=clock)
    for second in range(60):  # the diagnostics look once a second, and one message may be sent long before the others
        clock.now += 1.0
        if second == 30:
            monitor.arrived()
        monitor.status("n")
    for second in range(60):
        for _ in range(100 if second else 3):  # they begin between two looks
            clock.now += 0.01
            monitor.arrived()
        clock.now += 0.0 if second else 0.97
        assert monitor.status("n").level == OK, monitor.status("n").message
    for _ in range(1000):
        clock.now += 0.001
        monitor.arrived()
    assert "flood: 1000 Hz, usually 100 Hz" in monitor.status("n").message


def test_a_flood_of_nearly_equal_stamps_does_not_make_gaps_of_what_follows():
    monitor, _ = fed(100.0, 10)
    for k in range(500):
        monitor.stamped(1_001_000_000_000 + k)
    monitor.stamped(1_002_000_000_000)
    assert monitor.gaps < 20_000


def test_reasons_stay_bounded():
    monitor, _ = fed(10.0, 10)
    for k in range(5000):
        monitor.reject(f"station {k} unknown")
    assert len(monitor.status("n").values) < 120 and sum(monitor.rejected.values()) == 5000


def test_a_flood_of_near_equal_stamps_does_not_count_gaps_without_end():
    monitor = InputMonitor("imu/data_raw")
    for k in range(1000):
        monitor.stamped(1_000_000_000 + k)
    for k in range(1, 101):
        monitor.stamped(1_000_000_000 + 10_000_000 * k)
    assert monitor.gaps <= 100 * 100
