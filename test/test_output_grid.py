"""When the low-latency solution is due: by stamps, whatever the clocks do."""

from lowcostnav_ros.ros.output_grid import OutputGrid

PERIOD, MS = 50_000_000, 1_000_000


def due(grid, stamps, bases=None):
    return [t for t, base in zip(stamps, bases or stamps, strict=True) if grid.is_due(t, base)]


def test_one_solution_a_period_and_a_stamp_ahead_silences_nothing():
    stamps = list(range(1000 * MS, 2000 * MS, 10 * MS))
    assert due(OutputGrid(PERIOD), stamps) == stamps[::5]
    ahead = [t + 5000 * MS * (t == stamps[7]) for t in stamps]
    assert due(OutputGrid(PERIOD), ahead, stamps) == stamps[::5]


def test_a_recording_in_a_loop_of_any_length_goes_on():
    grid = OutputGrid(PERIOD)
    for length in (300 * MS, 9000 * MS, 60_000 * MS):
        stamps = list(range(10_000 * MS, 10_000 * MS + length, 10 * MS))
        for _ in range(3):
            assert due(grid, stamps) == stamps[::5]
