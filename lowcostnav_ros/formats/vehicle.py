"""What a log was recorded on: the navigators take the air for coming from ahead, as on an aeroplane."""

from lowcostnav_ros.formats.parser import Account

MULTICOPTER, GROUND, BOAT, SUBMARINE = "multicopter or helicopter", "ground vehicle", "boat", "submarine"
_BY_MAV_TYPE = dict.fromkeys((2, 3, 4, 13, 14, 15, 29, 35, 43), MULTICOPTER) | {10: GROUND, 11: BOAT, 12: SUBMARINE}
"""Of MAVLink's MAV_TYPE, which PX4 uses for its own vehicles, too."""
_BY_ARDUPILOT = {b"Copter": MULTICOPTER, b"Rover": GROUND, b"Sub": SUBMARINE}
"""Of the name of the firmware: ArduCopter, in earlier versions APM:Copter."""


def remark_type(account: Account, mav_type: int) -> None:
    """Say so in an account where the vehicle is no aeroplane; a type that is not known is taken for one."""
    _remark(account, _BY_MAV_TYPE.get(mav_type))


def remark_firmware(account: Account, raw: bytes) -> None:
    """Say so in an account where the bytes of an ArduPilot log name the firmware, or a parameter, of another vehicle."""
    named = next((kind for name, kind in _BY_ARDUPILOT.items() if b"Ardu" + name in raw or b"APM:" + name in raw), None)
    _remark(account, named or (MULTICOPTER if b"ATC_RAT_RLL_P" in raw and b"ArduPlane" not in raw else None))


def _remark(account: Account, kind: str | None) -> None:
    if kind is not None:
        account.remark(f"Recorded on a {kind}, no aeroplane: dead_reckoning and airdata_gps take the air for coming from ahead, and err.")
