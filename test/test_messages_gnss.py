"""Satellite observations as a point cloud: to the last bit and back, foreign layouts, what is refused and what is only marked."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lowcostnav_ros.base.measurements import GnssEpoch
from lowcostnav_ros.catalogue.config_files import config_dir, load_settings, yaml_of
from lowcostnav_ros.messages import topics
from lowcostnav_ros.messages.decode import Decoder, Rejected, decode
from lowcostnav_ros.messages.encode import encode_cdr
from lowcostnav_ros.messages.kinds.gnss_raw import POINT, cloud_of
from lowcostnav_ros.messages.store import STORE, from_cdr, to_cdr
from lowcostnav_ros.navigators.registry import NAVIGATORS

COLUMNS = [f.name for f in dataclasses.fields(GnssEpoch) if f.name not in ("stamp_ns", "source")]


def epoch(n=5, seed=0, **changes):
    rng = np.random.default_rng(seed)
    away = rng.normal(size=(n, 3))
    sat_pos = 2.66e7 * away / np.linalg.norm(away, axis=1)[:, None]
    numbers = rng.uniform(2e7, 3e7, n), rng.normal(size=n) * 500, rng.uniform(1, 9, n), rng.uniform(0.05, 1, n), rng.uniform(20, 50, n)
    valid = rng.random(n) > 0.3, rng.random(n) > 0.3
    system, sat_id = np.array(["G", "E"])[rng.integers(0, 2, n)], 1 + np.arange(n)
    made = GnssEpoch(1_780_336_800_123_456_789, "gnss/raw", system, sat_id, *numbers, sat_pos, rng.normal(size=(n, 3)) * 3e3, *valid)
    return dataclasses.replace(made, **changes)


def back(message):
    return decode("gnss/raw", topics.POINT_CLOUD, to_cdr(message))


@settings(deadline=None, max_examples=30)
@given(n=st.integers(1, 40), seed=st.integers(0, 1000))
def test_an_epoch_comes_back_to_the_last_bit(n, seed):
    sent = epoch(n, seed)
    ((stamp, topic, msgtype, raw),) = encode_cdr(sent)
    got = decode(topic, msgtype, raw)
    assert (stamp, topic, got.stamp_ns, got.source) == (sent.stamp_ns, "gnss/raw", sent.stamp_ns, "gnss/raw")
    for name in COLUMNS:
        assert np.array_equal(getattr(got, name), getattr(sent, name)), name


def test_the_fields_are_those_of_the_documented_table():
    message = cloud_of(epoch(3))
    assert [(f.name, f.offset, f.datatype) for f in message.fields][:2] == [("x", 0, 8), ("y", 8, 8)]
    assert message.point_step == POINT.itemsize == 91
    x = np.frombuffer(bytes(message.data), "<f8", count=1, offset=91 * 2)  # read by offset, without the table
    assert x[0] == epoch(3).sat_pos_e[2, 0]
    assert message.header.frame_id == "gps"


def test_a_sender_may_order_and_pad_the_fields_otherwise():
    sent, message = epoch(4), cloud_of(epoch(4))
    wide = np.dtype({"names": POINT.names[::-1], "formats": [POINT.fields[n][0] for n in POINT.names[::-1]]}, align=True)
    points = np.zeros(4, wide)
    for name in POINT.names:
        points[name] = np.frombuffer(bytes(message.data), POINT)[name]
    field = STORE.types["sensor_msgs/msg/PointField"]
    message.fields = [field(n, wide.fields[n][1], 8 if wide.fields[n][0].kind == "f" else 2, 1) for n in wide.names]
    message.point_step, message.row_step, message.data = wide.itemsize, 4 * wide.itemsize, np.frombuffer(points.tobytes(), np.uint8)
    assert np.array_equal(back(message).pseudorange_m, sent.pseudorange_m)
    assert np.array_equal(back(message).sat_vel_e, sent.sat_vel_e)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda m: setattr(m, "fields", m.fields[:-1]), "a field is missing"),
        (lambda m: setattr(m.fields[6], "datatype", 7), "a field has the wrong type or place"),
        (lambda m: setattr(m.fields[13], "offset", 91), "a field has the wrong type or place"),
        (lambda m: setattr(m, "data", m.data[:-1]), "length of the data does not fit"),
        (lambda m: setattr(m, "is_bigendian", True), "big-endian clouds are not read"),
        (lambda m: setattr(m, "width", 0), "number of satellites implausible"),
        (lambda m: setattr(m.header, "frame_id", "imu_link"), "wrong frame id"),
        (lambda m: setattr(m.header.stamp, "sec", 0) or setattr(m.header.stamp, "nanosec", 0), "stamp is zero"),
    ],
)
def test_a_cloud_that_is_not_an_epoch_is_refused_by_name(change, reason):
    message = from_cdr(to_cdr(cloud_of(epoch(4))), topics.POINT_CLOUD)
    message.data = message.data.copy()
    change(message)
    result = back(message)
    assert isinstance(result, Rejected) and result.reason == reason


def heard(message):
    """Epoch and notes of a message."""
    decoder = Decoder()
    return decoder.decode("gnss/raw", topics.POINT_CLOUD, to_cdr(message)), decoder.notes


def valid(n):
    return {"range_valid": np.ones(n, bool), "doppler_valid": np.ones(n, bool)}


def test_of_a_satellite_named_twice_every_copy_goes_and_the_others_stay():
    sent = epoch(5, system=np.full(5, "G"), sat_id=np.array([7, 8, 7, 9, 7]), **valid(5))
    got, notes = heard(cloud_of(sent))
    assert got.sat_id.tolist() == [8, 9]
    assert np.array_equal(got.pseudorange_m, sent.pseudorange_m[[1, 3]]) and np.array_equal(got.sat_pos_e, sent.sat_pos_e[[1, 3]])
    assert notes == {"gnss/raw: G07: contradictory copies excluded": 3}


def test_the_same_number_in_two_systems_is_two_satellites():
    got, notes = heard(cloud_of(epoch(2, system=np.array(["G", "E"]), sat_id=np.array([7, 7]))))
    assert len(got) == 2 and not notes


def test_two_signals_that_agree_are_one_observation_the_better():
    once = epoch(4, **valid(4))
    twice = dataclasses.replace(once, **{name: np.concatenate([getattr(once, name)] * 2) for name in COLUMNS})
    twice.pseudorange_m[4:] += 3.0 * np.hypot(once.sigma_m, 0.5)
    twice.sigma_m[4:6], twice.sigma_m[6:] = 0.5, once.sigma_m[2:] + 1.0
    got, notes = heard(cloud_of(twice))
    assert got.sat_id.tolist() == once.sat_id.tolist()
    assert np.array_equal(got.pseudorange_m, twice.pseudorange_m[[4, 5, 2, 3]])
    assert sum(notes.values()) == 4 and all("second signal not used" in note for note in notes)


@pytest.mark.parametrize(("flags", "value"), [(0, 2.2e7), (3, np.nan)])
def test_a_copy_without_an_observation_contradicts_nobody(flags, value):
    twice = epoch(2, system=np.full(2, "G"), sat_id=np.array([7, 7]), **valid(2))
    message = cloud_of(twice)
    points = np.frombuffer(bytes(message.data), POINT).copy()
    points["flags"][0], points["pseudorange"][0], points["doppler"][0] = flags, value, np.nan
    message.data = np.frombuffer(points.tobytes(), np.uint8)
    got, _ = heard(message)
    assert got.pseudorange_m.tolist() == [twice.pseudorange_m[1]] and got.range_valid.tolist() == [True]


def test_a_cloud_of_nothing_but_contradictions_is_refused():
    result = back(cloud_of(epoch(2, system=np.full(2, "G"), sat_id=np.array([7, 7]), **valid(2))))
    assert isinstance(result, Rejected) and result.reason == "every satellite appears twice and contradicts itself"


@pytest.mark.parametrize(
    ("column", "value", "lost"),
    [
        ("pseudorange_m", np.nan, "range_valid"),
        ("pseudorange_m", 3.0e3, "range_valid"),
        ("sigma_m", 0.0, "range_valid"),
        ("doppler_mps", np.inf, "doppler_valid"),
        ("sigma_mps", -1.0, "doppler_valid"),
        ("sat_pos_e", np.nan, "range_valid"),
    ],
)
def test_one_impossible_observation_is_marked_and_the_others_stay(column, value, lost):
    good = {"range_valid": np.ones(5, bool), "doppler_valid": np.ones(5, bool)}
    values = getattr(epoch(), column).copy()
    values[2] = value
    decoder = Decoder()
    got = decoder.decode("gnss/raw", topics.POINT_CLOUD, to_cdr(cloud_of(epoch(**good, **{column: values}))))
    assert not getattr(got, lost)[2] and np.count_nonzero(getattr(got, lost)) == 4
    assert all(np.isfinite(getattr(got, name)).all() for name in COLUMNS if name not in ("system", "sat_id"))
    assert sum(decoder.notes.values()) >= 1


@pytest.mark.parametrize("name", ["gnss_only", "ins_gnss"])
def test_parameter_files_hold_the_defaults_word_for_word(name):
    navigator_class = NAVIGATORS[name]
    settings_class = navigator_class.Settings
    path = config_dir() / f"{name}.yaml"
    text = path.read_text(encoding="utf-8")
    assert text == yaml_of(settings_class)
    assert load_settings(settings_class, path, name) == settings_class()
    assert navigator_class(settings_class()).name == name
