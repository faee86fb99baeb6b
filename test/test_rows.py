"""Solutions written as rows while nothing has to be looked at: the same as one by one."""

import dataclasses

import numpy as np
import pytest

from lowcostnav_ros.base.measurements import AirVelocity, GpsPosition, GpsVelocity, ImuBlock, Measurement
from lowcostnav_ros.cores import rows
from lowcostnav_ros.navigators.ins_gps import InsGps, InsGpsSettings
from lowcostnav_ros.navigators.solutions import Solutions, is_sound
from lowcostnav_ros.physics.rotation import quat_conjugate, quat_rotate
from lowcostnav_ros.replay.columns import columns_of
from lowcostnav_ros.trajectory import build
from lowcostnav_ros.trajectory.missions import standard

LOST_S = 70, 95


@pytest.fixture(scope="module")
def flight() -> list[Measurement]:
    """Blocks of a second and a fix with each, an airspeed twice a second; no GPS in between."""
    truth, rng, out = build(standard("banked_turns", kind="segments", duration_s=130.0)).table(), np.random.default_rng(3), []
    for first in range(0, len(truth) - 99, 100):
        t = truth[first : first + 100]
        force, rate = t.specific_force_b + 0.02 * rng.standard_normal((100, 3)), t.angular_rate_b + 0.002 * rng.standard_normal((100, 3))
        out.append(ImuBlock.of("imu/data_raw", t.stamps_ns, force, rate))
        for row in (47, 99):
            air = quat_rotate(quat_conjugate(t.q_nb[row]), t.vel_n[row] - np.array([4.0, -3.0, 0.0]))
            out.append(AirVelocity(int(t.stamps_ns[row]), "air/velocity", air, np.eye(3)))
        if not LOST_S[0] <= first // 100 < LOST_S[1]:
            stamp = int(t.stamps_ns[-1])
            out.append(GpsPosition(stamp, "gps/fix", t.lat[-1], t.lon[-1], t.height[-1], np.eye(3) * 4.0))
            out.append(GpsVelocity(stamp, "gps/vel", t.vel_n[-1] + 0.1 * rng.standard_normal(3), np.eye(3) * 0.01))
    return out


def said(solution) -> list:
    """All of a solution, arrays as bytes."""
    values = (getattr(solution, field.name) for field in dataclasses.fields(solution))
    plain = [v.tobytes() if isinstance(v, np.ndarray) else v for v in values]
    return [dict(v) if v is solution.states and v is not None else repr(v) if v is solution.health else v for v in plain]


def test_what_is_written_on_the_way_is_what_a_look_at_every_output_gives(flight, monkeypatch):
    written = InsGps(InsGpsSettings()).feed_all(flight)
    assert max(len(part) for part in written.parts if isinstance(part, rows.Rows)) >= 5
    monkeypatch.setattr(InsGps, "_is_calm", lambda self, end_ns: False)
    looked_at = InsGps(InsGpsSettings()).feed_all(flight)
    assert all(len(part) == 1 for part in looked_at.parts)
    assert {s.mode for s in looked_at} == {"gps", "coasting"} and sum(s.health is not None for s in looked_at) > 100
    assert [said(s) for s in written] == [said(s) for s in looked_at]


def test_an_attitude_that_was_moved_by_chance_is_doubted_on_the_way_as_at_every_output(flight, monkeypatch):
    def flown():
        navigator = InsGps(InsGpsSettings())
        navigator.feed_all(flight[:150])
        navigator.attitude_watch.one_way.moved[:] = 2e-3, 3e-3, 0.0
        return navigator.feed_all(flight[150:])

    written = flown()
    assert max(len(part) for part in written.parts if isinstance(part, rows.Rows)) >= 5
    assert all(s.cov_att[2, 2] > 1e-6 for s in written[:100])
    monkeypatch.setattr(InsGps, "_is_calm", lambda self, end_ns: False)
    assert [said(s) for s in written] == [said(s) for s in flown()]


def test_solutions_are_a_sequence_whatever_they_are_made_of(flight):
    solutions = InsGps(InsGpsSettings()).feed_all(flight[:200])
    every = list(solutions)
    assert len(solutions) == len(every) > 100
    for k in (0, 7, len(every) - 1, -1, -2, -len(every)):
        assert said(solutions[k]) == said(every[k])
    assert [s.stamp_ns for s in solutions[3:6]] == [s.stamp_ns for s in every[3:6]]
    cut = solutions.between(every[1].stamp_ns, every[-2].stamp_ns)
    assert [said(s) for s in cut] == [said(s) for s in every[1:-2]]
    columns, objects = columns_of(solutions), columns_of(every)
    assert np.isfinite(columns.wind_n[-1]).all()
    for name in columns.__dataclass_fields__:
        assert np.array_equal(getattr(columns, name), getattr(objects, name), equal_nan=True)
    assert len(Solutions() + solutions) == len(every) == len([] + solutions)


@pytest.mark.parametrize("spoil", ["nav", "P", "variance", "wind", "force", "rate"])
def test_a_row_is_sound_where_its_solution_is(spoil):
    rng, size = np.random.default_rng(1), 17
    A = rng.standard_normal((size, size))
    nav, P, estimate, force, rate = rng.standard_normal(10), A @ A.T, rng.standard_normal(size), np.ones(3), np.ones(3)
    page = rows.Page(size, 1, 0, 0.1 * np.eye(9), 9)
    page.stamps_ns[0] = 5
    labels = tuple(f"state_{k}" for k in range(size - 9))

    def written():
        sound = rows.write(nav, P, page.added, estimate, force, rate, page.wind, page.table[0])
        return sound, rows.Rows("it", page.stamps_ns, page.table, labels, page.wind, "gps").solution(0)

    sound, solution = written()
    assert sound and is_sound(solution)
    assert np.array_equal(solution.cov_vel, P[3:6, 3:6] + page.added[3:6, 3:6]) and np.array_equal(solution.cov_wind, P[9:11, 9:11])
    assert solution.states[labels[5]] == (estimate[14], pytest.approx(np.sqrt(P[14, 14])))
    assert np.array_equal(solution.wind_n, estimate[9:11])
    {"nav": nav, "force": force, "rate": rate, "wind": estimate[9:], "P": P[4], "variance": P[7]}[spoil][:] = (
        -100.0 * np.eye(size)[7] if spoil == "variance" else np.nan
    )
    sound, solution = written()
    assert not sound and not is_sound(solution)
