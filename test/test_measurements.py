"""Inertial blocks cut by slice, indices and mask."""

import numpy as np
import pytest

from lowcostnav_ros.base.measurements import ImuBlock

STAMPS = np.array([10, 20, 30, 40], dtype=np.int64)
BLOCK = ImuBlock.of("imu/data_raw", STAMPS, np.arange(12.0).reshape(4, 3), -np.arange(12.0).reshape(4, 3))


@pytest.mark.parametrize(
    ("rows", "kept"),
    [(slice(0, 2), [0, 1]), (slice(2, None), [2, 3]), (np.array([1, 3]), [1, 3]), (np.array([True, False, True, False]), [0, 2])],
)
def test_some_samples_of_a_block_end_at_their_own_last_stamp(rows, kept):
    part = BLOCK[rows]
    assert part.stamp_ns == STAMPS[kept[-1]] and part.source == BLOCK.source and len(part) == len(kept)
    assert isinstance(part.stamp_ns, int)
    for name in ("stamps_ns", "specific_force_b", "angular_rate_b"):
        assert np.array_equal(getattr(part, name), getattr(BLOCK, name)[kept])


def test_an_empty_part_keeps_the_stamp_of_its_block():
    assert len(BLOCK[4:]) == 0 and BLOCK[4:].stamp_ns == 40
