"""NetFIX: the text protocol of the open avionics bus of amateur-built aircraft, ``key;value;flags``, both ways.

A gateway serves it over TCP, port 3490.  It sends a value each time it is written, to whoever subscribed (``@sKEY``), with the flags
annunciate, old, bad, failed, secondary failed; a client writes a value by the same line, where the flag ``old`` is left out.  Values are
strings of knots, feet and degrees, and carry no time: a measurement is stamped when it came.

References
----------
FIX-Gateway, Net-FIX ASCII Protocol Description and its database of keys.
"""

import math
import re
from collections.abc import Callable, Iterable, Iterator

import numpy as np

from lowcostnav_ros.base.documents import number_in
from lowcostnav_ros.base.measurements import UNKNOWN_VARIANCE, AirTemperature, AirVelocity, GpsPosition, GpsVelocity, Measurement, Pressure
from lowcostnav_ros.base.units import DEGREE, FOOT, FOOT_PER_MINUTE, KNOT, kelvin
from lowcostnav_ros.catalogue.geoid import undulation
from lowcostnav_ros.formats.air import RATIO_SIGMA, true_airspeed
from lowcostnav_ros.formats.cockpit import Picture
from lowcostnav_ros.formats.framing import LineFramer
from lowcostnav_ros.formats.parser import ARRIVAL, Parser
from lowcostnav_ros.physics.geomagnetism import DatedModel

KEYS = ("LAT", "LONG", "GPS_ELLIPSOID_ALT", "TALT", "GPS_ACCURACY_HORIZ", "GPS_ACCURACY_VERTICAL", "GS", "TRACK", "IAS", "TAS", "AIRPRESS",
        "DIFFAIRPRESS", "OAT")  # fmt: skip
"""What a driver subscribes to."""
_LINE = re.compile(rb"(@[a-zA-Z].*|[A-Z][A-Z0-9_]*(\.\w+)?;[^;]*(;[01]{0,5})?)")
TOGETHER_NS, GOOD_NS = 50_000_000, 2 * 10**9
"""Two values of one measurement come within this time; one that another needs is not older than that."""
FIX_SIGMA_M, HEIGHT_SIGMA_M, SPEED_SIGMA_MPS, STATIC_SIGMA_PA, IMPACT_SIGMA_PA, AIRSPEED_SIGMA_MPS, KELVIN = (
    10.0,
    15.0,
    0.5,
    60.0,
    20.0,
    1.5,
    2.0,
)
"""Where the bus states no accuracy."""


class NetfixLines:
    """What a navigator says as values of the bus; ``bad`` where it flies by dead reckoning, ``failed`` where it is not to be shown."""

    def __init__(self) -> None:
        self._field = DatedModel(0.0)

    def frames(self, picture: Picture, is_second: bool) -> list[bytes]:
        """Return a line for every key, those of the position once a second."""
        p, keys = picture, dict[str, tuple[float | None, float]]()
        if is_second:
            keys = {"LAT": (p.lat, DEGREE), "LONG": (p.lon, DEGREE), "GPS_ELLIPSOID_ALT": (p.height, FOOT)}
            keys["GPS_ACCURACY_HORIZ"] = p.radius_95_m, FOOT
        keys["TALT"] = None if p.height is None else p.height - p.sea_level, FOOT
        keys["VS"] = None if p.vel_n is None else -float(p.vel_n[2]), FOOT_PER_MINUTE
        keys |= {"GS": (p.speed_mps, KNOT), "TRACK": (p.track, DEGREE), "ROLL": (p.roll, DEGREE), "PITCH": (p.pitch, DEGREE)}
        keys["HEAD"] = self._magnetic(p), DEGREE
        flags = f"0{int(p.is_degraded)}00"
        lines = [
            f"{key};0.0;0010" if v is None else f"{key};{v / unit:.{7 if key[0] == 'L' else 1}f};{flags}" for key, (v, unit) in keys.items()
        ]
        return [line.encode("ascii") + b"\n" for line in lines]

    def _magnetic(self, picture: Picture) -> float | None:
        if picture.heading is None or picture.lat is None or picture.lon is None:
            return None
        self._field.follow(picture.stamp_ns)
        if self._field.model is None:
            return None
        return (picture.heading - self._field.model.declination(picture.lat, picture.lon, picture.height or 0.0)) % (2.0 * math.pi)


class NetfixParser(Parser):
    """Values of a gateway: pressures, temperature, airspeed, position and velocity over ground."""

    clock = ARRIVAL
    greeting = b"".join(f"@s{key}\n".encode("ascii") for key in KEYS)

    def __init__(self) -> None:
        super().__init__()
        self.framer = LineFramer("NetFIX", lambda line: _LINE.fullmatch(line) is not None)
        self._values: dict[str, tuple[int, float]] = {}
        self._readers: dict[str, Callable[[int], Iterable[Measurement]]] = {
            "AIRPRESS": self._pressure, "DIFFAIRPRESS": self._pressure, "OAT": self._temperature, "TAS": self._airspeed,
            "IAS": self._airspeed, "LAT": self._fix, "LONG": self._fix, "GS": self._velocity, "TRACK": self._velocity,
        }  # fmt: skip

    def take(self, protocol: str, frame: bytes) -> Iterator[Measurement]:
        """Take over a value and yield what it completes."""
        key, _, rest = frame.decode("ascii", "replace").partition(";")
        text, _, flags = rest.partition(";")
        if key[:1] == "@":
            if "!" in key:
                self.account.refused["the gateway does not have a key that is asked for"] += 1
            return
        if key not in KEYS:
            self.account.left_out[f"NetFIX {key[:20]}"] += 1
            return
        stated = dict(zip("aobfs", flags.ljust(5, "0"), strict=False))
        if "1" in (stated["o"], stated["b"], stated["f"]):
            self.account.refused[f"NetFIX {key} flagged old, bad or failed"] += 1
            self._values.pop(key, None)
            return
        value = number_in(text)
        if not math.isfinite(value):
            self.account.refused[f"NetFIX {key} is no number"] += 1
            return
        self._values[key] = self.arrived_ns, value
        if key in self._readers:
            yield from self._readers[key](self.arrived_ns)

    def _get(self, key: str, within_ns: int = GOOD_NS) -> float | None:
        at = self._values.get(key)
        return at[1] if at is not None and self.arrived_ns - at[0] <= within_ns else None

    def _pair(self, first: str, second: str) -> tuple[float, float] | None:
        """Two values that came together; used once."""
        one, other = self._get(first, TOGETHER_NS), self._get(second, TOGETHER_NS)
        if one is None or other is None:
            return None
        del self._values[first], self._values[second]
        return one, other

    def _pressure(self, stamp_ns: int) -> Iterator[Measurement]:
        for key, source, sigma in (
            ("AIRPRESS", "air/static_pressure", STATIC_SIGMA_PA),
            ("DIFFAIRPRESS", "air/dynamic_pressure", IMPACT_SIGMA_PA),
        ):
            value = self._get(key, 0)
            if value is not None and self.is_new(source, stamp_ns):
                self.account.origins.setdefault(source, f"NetFIX {key}, Pa")
                yield Pressure(stamp_ns, source, value, sigma**2)

    def _temperature(self, stamp_ns: int) -> Iterator[Measurement]:
        value = self._get("OAT", 0)
        if value is not None and self.is_new("air/temperature", stamp_ns):
            yield AirTemperature(stamp_ns, "air/temperature", kelvin(value), KELVIN**2)

    def _airspeed(self, stamp_ns: int) -> Iterator[Measurement]:
        """True airspeed as the bus has it, else made of the indicated one and the static pressure."""
        knots, static = self._get("TAS"), self._get("AIRPRESS")
        if knots is None and (self._get("IAS") is None or static is None or not 1e4 < static < 1.2e5):
            return
        if knots is None:
            outside = self._get("OAT")
            tas = float(true_airspeed(max(self._values["IAS"][1], 0.0) * KNOT, static, None if outside is None else kelvin(outside)))
        elif self._values["TAS"][0] == stamp_ns:
            tas = knots * KNOT
        else:
            return
        if math.isfinite(tas) and self.is_new("air/velocity", stamp_ns):
            self.account.origins.setdefault("air/velocity", "NetFIX TAS, kt" if knots is not None else "NetFIX IAS, kt, and AIRPRESS")
            cov = np.diag([AIRSPEED_SIGMA_MPS**2 + (RATIO_SIGMA * tas) ** 2, UNKNOWN_VARIANCE, UNKNOWN_VARIANCE])
            yield AirVelocity(stamp_ns, "air/velocity", np.array([tas, 0.0, 0.0]), cov)

    def _fix(self, stamp_ns: int) -> Iterator[Measurement]:
        pair = self._pair("LAT", "LONG")
        if pair is None or not (abs(pair[0]) <= 90.0 and abs(pair[1]) <= 180.0):
            return
        lat, lon = np.radians(pair).tolist()
        ellipsoidal, above_sea = self._get("GPS_ELLIPSOID_ALT"), self._get("TALT")
        radius, vertical = self._get("GPS_ACCURACY_HORIZ") or 0.0, self._get("GPS_ACCURACY_VERTICAL") or 0.0
        level, down = radius * FOOT if radius > 0.0 else FIX_SIGMA_M, vertical * FOOT if vertical > 0.0 else HEIGHT_SIGMA_M
        height = 0.0
        if ellipsoidal is not None:
            height = ellipsoidal * FOOT
        elif above_sea is not None:
            height = above_sea * FOOT + float(undulation(lat, lon))
        else:
            down = math.sqrt(UNKNOWN_VARIANCE)
        if self.is_new("gps/fix", stamp_ns):
            yield GpsPosition(stamp_ns, "gps/fix", lat, lon, height, np.diag([level**2, level**2, down**2]))

    def _velocity(self, stamp_ns: int) -> Iterator[Measurement]:
        pair = self._pair("GS", "TRACK")
        if pair is not None and self.is_new("gps/vel", stamp_ns):
            speed, track = pair[0] * KNOT, pair[1] * DEGREE
            cov = np.diag([SPEED_SIGMA_MPS**2, SPEED_SIGMA_MPS**2, UNKNOWN_VARIANCE])
            yield GpsVelocity(stamp_ns, "gps/vel", np.array([speed * math.cos(track), speed * math.sin(track), 0.0]), cov)
