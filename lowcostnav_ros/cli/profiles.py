"""The profiles job: the IMU profiles there are, with their grade, and what a filter makes of one.

lowcostnav profiles
lowcostnav profiles crista
lowcostnav profiles result/profile.yaml
"""

import argparse
import dataclasses

import numpy as np

from lowcostnav_ros.base.tables import Table
from lowcostnav_ros.base.units import DEGREE, DEGREE_PER_HOUR, MILLI_G
from lowcostnav_ros.catalogue.equipment import imu_profile_names, load_imu_profile
from lowcostnav_ros.catalogue.imu_by_name import profile_settings
from lowcostnav_ros.cli.jobs import job
from lowcostnav_ros.physics.unaided_growth import by_source_m
from lowcostnav_ros.report.terminal import print_report
from lowcostnav_ros.sensors.imu_grade import grade_of
from lowcostnav_ros.sensors.imu_profile import ImuProfile

AFTER_S = (10.0, 30.0, 60.0, 120.0, 300.0)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the job."""
    text = "name of a shipped profile, or a profile file (default: list all shipped)"
    parser.add_argument("names", nargs="*", metavar="PROFILE", help=text)


EXAMPLE = "example: lowcostnav profiles crista"


@job("IMU profiles with their grade, and the numbers a filter takes from one.", add_arguments, EXAMPLE)
def profiles(arguments: argparse.Namespace) -> int:
    """List profiles; of one that was asked for also what a filter takes from it."""
    names = arguments.names or imu_profile_names()
    _print_table({name: load_imu_profile(name) for name in names})
    for name in arguments.names:
        _print_settings(name)
        _print_growth(load_imu_profile(name))
    if not arguments.names:
        print("A navigator takes one by name: imu.profile in its settings; 'lowcostnav profiles NAME' shows the numbers.")
    return 0


def _print_table(found: dict[str, ImuProfile]) -> None:

    gyros, accels = ("gyro turn-on\ndeg/h", "drift\ndeg/h", "white\ndeg/rt h"), ("accel turn-on\nmg", "drift\nmg", "white\nmg/rt Hz")
    rows = []
    for name, profile in found.items():
        gyro, accel = profile.gyro_noise(), profile.accel_noise()
        values = (
            gyro.turn_on_sigma / DEGREE_PER_HOUR,
            gyro.bias_sigma / DEGREE_PER_HOUR,
            60.0 * gyro.noise_density / DEGREE,
            accel.turn_on_sigma / MILLI_G,
            accel.bias_sigma / MILLI_G,
            accel.noise_density / MILLI_G,
        )
        rows.append((name, grade_of(profile) or "-", profile.source, *(f"{np.max(v):.3g}" if np.any(v) else "-" for v in values)))
    note = "Worst axis, one sigma; - is not stated. The grade is that of the gyro bias, turn-on and drift (Solimeno 2007, table 3.4)."
    print_report("", [Table.plain("", ("profile", "grade", "from", *gyros, *accels), rows, left=3)], [note])


def _print_settings(name: str) -> None:
    print(f"\n{name} in a filter's settings (imu.profile: {name}):")
    for key, value in dataclasses.asdict(profile_settings(name)).items():
        if key != "profile":
            numbers = [f"{v:.6g}" for v in (value if isinstance(value, list) else [value])]
            print(f"  imu.{key}: {numbers[0] if len(numbers) == 1 else '[' + ', '.join(numbers) + ']'}")


def _print_growth(profile: ImuProfile) -> None:
    """What the errors make of the position of one axis without any aid."""
    gyro, accel = profile.gyro_noise(), profile.accel_noise()
    biases = [float(np.max(np.hypot(one.turn_on_sigma, one.bias_sigma))) for one in (gyro, accel)]
    print()
    found = by_source_m(biases[0], biases[1], float(np.max(gyro.noise_density)), float(np.max(accel.noise_density)), np.array(AFTER_S))
    rows = [(source, *(f"{value:.3g}" for value in np.atleast_1d(metres))) for source, metres in found.items()]
    note = "One axis, one sigma, from a perfect start, the biases constant: beyond some 300 s the Schuler oscillation bounds it."
    print_report("", [Table.plain("unaided, position error", ("m", *(f"{t:g} s" for t in AFTER_S)), rows)], [note])
