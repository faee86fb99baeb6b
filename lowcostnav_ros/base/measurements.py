"""Measurements: everything a navigator ever sees, as small frozen values.

A measurement has a stamp (integer nanoseconds, time of validity), a source (the topic it came on, without a leading slash), SI
values in NED/FRD and a covariance.  Live nodes, bags and simulations make the same values, so a driver, a simulator and a
recording are the same thing to everything downstream.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import cast

import numpy as np

UNKNOWN_VARIANCE = 1.0e6
"""Variance at or above which a component counts as not measured (e.g. sideslip without a vane)."""


@dataclass(frozen=True, slots=True, eq=False)
class Measurement:
    """Common head of every measurement: stamp (ns) and source (topic name)."""

    stamp_ns: int
    source: str

    part = ""  # separates measurements of one stamp and source, where a kind has several

    def __deepcopy__(self, memo: dict) -> "Measurement":
        """Return itself: nobody changes it, so a copy of a navigator shares what it holds."""
        return self


@dataclass(frozen=True, slots=True, eq=False)
class ImuBlock(Measurement):
    """One or many consecutive inertial samples; ``stamp_ns`` is the stamp of the last.

    Sample k holds the mean specific force and mean angular rate over the interval that ends at ``stamps_ns[k]``.

    Attributes
    ----------
    stamps_ns : ndarray of int64, shape (n,)
    specific_force_b : ndarray, shape (n, 3)
        m/s^2, FRD.
    angular_rate_b : ndarray, shape (n, 3)
        rad/s, FRD, relative to inertial space.
    """

    stamps_ns: np.ndarray
    specific_force_b: np.ndarray
    angular_rate_b: np.ndarray

    @classmethod
    def of(cls, source: str, stamps_ns: np.ndarray, specific_force_b: np.ndarray, angular_rate_b: np.ndarray) -> "ImuBlock":
        """Build a block from columns; the head stamp is the last of ``stamps_ns``."""
        return cls(int(stamps_ns[-1]), source, stamps_ns, specific_force_b, angular_rate_b)

    @classmethod
    def joined(cls, blocks: "Sequence[ImuBlock]") -> "ImuBlock":
        """One block of several that follow one another."""
        columns = (np.concatenate([getattr(b, name) for b in blocks]) for name in ("stamps_ns", "specific_force_b", "angular_rate_b"))
        return cls.of(blocks[-1].source, *columns)

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def __getitem__(self, rows: slice | np.ndarray) -> "ImuBlock":
        """Return some of the samples, by slice, indices or mask; an empty block keeps the head stamp."""
        stamps = self.stamps_ns[rows]
        head = int(stamps[-1]) if len(stamps) else self.stamp_ns
        return ImuBlock(head, self.source, stamps, self.specific_force_b[rows], self.angular_rate_b[rows])


@dataclass(frozen=True, slots=True, eq=False)
class Attitude(Measurement):
    """Attitude from an AHRS, ours or a foreign one.

    ``q_nb`` (4,) Hamilton, scalar first, FRD to true NED; ``cov_att`` (3, 3) of the small rotation resolved in n, rad^2;
    ``angular_rate_b`` (3,) rad/s and ``specific_force_b`` (3,) m/s^2 as the AHRS passes them on.
    """

    q_nb: np.ndarray
    cov_att: np.ndarray
    angular_rate_b: np.ndarray
    specific_force_b: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class MagneticField(Measurement):
    """Magnetic field ``field_b`` (3,) tesla, FRD, calibrated or not, depending on the source; ``cov_b`` (3, 3) T^2."""

    field_b: np.ndarray
    cov_b: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class GpsPosition(Measurement):
    """Position fix: ``lat``, ``lon`` rad, ``height`` m above the ellipsoid, ``cov_n`` (3, 3) m^2 in NED.

    A height whose variance reaches :data:`UNKNOWN_VARIANCE` is not measured.
    """

    lat: float
    lon: float
    height: float
    cov_n: np.ndarray

    @property
    def has_height(self) -> bool:
        """Whether the height is measured."""
        return bool(self.cov_n[2, 2] < UNKNOWN_VARIANCE)


@dataclass(frozen=True, slots=True, eq=False)
class GpsVelocity(Measurement):
    """Velocity over ground ``vel_n`` (3,) m/s, NED; ``cov_n`` (3, 3)."""

    vel_n: np.ndarray
    cov_n: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class Pressure(Measurement):
    """Static or dynamic pressure, Pa; which one is the source's name; ``variance`` Pa^2."""

    pressure_pa: float
    variance: float


@dataclass(frozen=True, slots=True, eq=False)
class AirTemperature(Measurement):
    """Outside (static) air temperature, kelvin; ``variance`` K^2."""

    temperature_k: float
    variance: float


@dataclass(frozen=True, slots=True, eq=False)
class AirVelocity(Measurement):
    """Air-relative velocity ``vel_b`` (3,) m/s, FRD: x forward, y from sideslip, z from incidence.

    A component whose variance in ``cov_b`` (3, 3) reaches :data:`UNKNOWN_VARIANCE` is not measured.
    """

    vel_b: np.ndarray
    cov_b: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class SlantRange(Measurement):
    """One DME reply: slant range ``range_m`` metres to the station named ``station``; ``variance`` m^2."""

    station: str
    range_m: float
    variance: float

    part = property(attrgetter("station"))


@dataclass(frozen=True, slots=True, eq=False)
class VorBearing(Measurement):
    """One reading of a VOR receiver: the radial of the station named ``station`` on which the aircraft is.

    ``bearing_rad`` in [0, 2 pi) is clockwise FROM the station TO the aircraft, counted from the station's own north: true bearing =
    ``bearing_rad`` + declination of the station (east positive, from the station table).  ``variance`` rad^2, of the whole error.
    """

    station: str
    bearing_rad: float
    variance: float

    part = property(attrgetter("station"))


@dataclass(frozen=True, slots=True, eq=False)
class GnssEpoch(Measurement):
    """Satellite observations of one instant, as columns of n satellites, ready for a navigator.

    What the satellites and the atmosphere add is already taken off (satellite clock, relativity, group delay, ionosphere, troposphere) and
    satellite states stand in ECEF at the time of reception, so that with e the unit vector from the receiver to the satellite

        pseudorange_m = |sat_pos_e - r_e| + clock_m + noise,    doppler_mps = e . (sat_vel_e - v_e) + clock_drift_mps + noise

    Attributes
    ----------
    system : ndarray of str, shape (n,)
        ``G`` GPS, ``E`` Galileo; systems may differ by a constant clock offset.
    sat_id : ndarray of int, shape (n,)
    pseudorange_m : ndarray, shape (n,)
    doppler_mps : ndarray, shape (n,)
        Range rate, m/s, positive receding.
    sigma_m, sigma_mps : ndarray, shape (n,)
        1-sigma of the two, m and m/s.
    cn0 : ndarray, shape (n,)
        Carrier to noise density, dB-Hz; 0 where the receiver does not report it.
    sat_pos_e, sat_vel_e : ndarray, shape (n, 3)
        M and m/s.
    range_valid, doppler_valid : ndarray of bool, shape (n,)
        False: leave this observation out; its number is finite but means nothing.
    """

    system: np.ndarray
    sat_id: np.ndarray
    pseudorange_m: np.ndarray
    doppler_mps: np.ndarray
    sigma_m: np.ndarray
    sigma_mps: np.ndarray
    cn0: np.ndarray
    sat_pos_e: np.ndarray
    sat_vel_e: np.ndarray
    range_valid: np.ndarray
    doppler_valid: np.ndarray

    def __len__(self) -> int:
        return len(self.sat_id)

    def rows(self, rows: np.ndarray) -> "GnssEpoch":
        """Return the same epoch with some satellites only."""
        columns = (getattr(self, name)[rows] for name in self.__dataclass_fields__ if name not in ("stamp_ns", "source"))
        return GnssEpoch(self.stamp_ns, self.source, *columns)


@dataclass(frozen=True, slots=True, eq=False)
class CarrierEpoch(Measurement):
    """Code, carrier and Doppler of several transmitters at one instant, as columns of n.

    With r the distance to the transmitter, T what the troposphere adds and d the receiver clock, all in m,

        code_m = r + T + d + noise,   carrier_cycles = (r + T + d + noise)/wavelength_m + N,   doppler_hz = -(dr/dt + dd/dt)/wavelength_m

    and N a constant as long as the receiver keeps counting.  Transmitters stand in the station table by ident, unless ``pos_e`` and
    ``vel_e`` say where they are: satellites, whose epochs are differences to a base, what the base is away from the satellite added back.

    Attributes
    ----------
    ident : ndarray of str, shape (n,)
    code_m, carrier_cycles, doppler_hz : ndarray, shape (n,)
        Doppler positive closing.
    wavelength_m : ndarray, shape (n,)
    cn0 : ndarray, shape (n,)
        Carrier to noise density, dB-Hz; 0 where the receiver does not report it.
    code_valid, carrier_valid : ndarray of bool, shape (n,)
        False: its number is finite but means nothing; a carrier is not valid without its Doppler.
    pos_e, vel_e : ndarray, shape (n, 3), or None
        ECEF, m and m/s.
    """

    ident: np.ndarray
    code_m: np.ndarray
    carrier_cycles: np.ndarray
    doppler_hz: np.ndarray
    wavelength_m: np.ndarray
    cn0: np.ndarray
    code_valid: np.ndarray
    carrier_valid: np.ndarray
    pos_e: np.ndarray | None = None
    vel_e: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.ident)

    def rows(self, rows: np.ndarray) -> "CarrierEpoch":
        """Return the same epoch with some transmitters only."""
        columns = {name: getattr(self, name) for name in self.__dataclass_fields__ if name not in ("stamp_ns", "source")}
        return replace(self, **{name: column[rows] for name, column in columns.items() if column is not None})


@dataclass(frozen=True, slots=True, eq=False)
class StationWeather(Measurement):
    """Weather at ground stations, as columns of n: ``ident``, ``pressure_pa``, ``temperature_k``, relative ``humidity`` (0 to 1)."""

    ident: np.ndarray
    pressure_pa: np.ndarray
    temperature_k: np.ndarray
    humidity: np.ndarray

    def __len__(self) -> int:
        return len(self.ident)


@dataclass(slots=True)
class Integrity:
    """Result of a navigator's integrity tests.

    Attributes
    ----------
    verdict : str
        ``healthy``; ``excluded`` (satellites are excluded, the rest agree); ``faulty`` (they contradict each other and which is
        faulty is not observable); ``not possible`` (too few to check with, which is not healthy).
    reason : str
        One sentence; empty when healthy.
    excluded : dict of str to str
        Why each satellite is excluded, by name.
    hpl_m, vpl_m : float or None
        Horizontal and vertical protection level: the error that any one further fault can cause unnoticed, m.
    lasting_hpl_m, lasting_vpl_m : float or None
        The same for a fault that has lasted as long as the longest of the tests' windows.
    alarm : str
        First disagreement of all satellites with the inertial sensors, or of the receiver's clock with itself; kept until a fresh start.
    alarm_ns : int or None
        Its stamp.
    """

    verdict: str = "not possible"
    reason: str = "no epoch yet"
    excluded: dict[str, str] = field(default_factory=dict)
    hpl_m: float | None = None
    vpl_m: float | None = None
    lasting_hpl_m: float | None = None
    lasting_vpl_m: float | None = None
    alarm: str = ""
    alarm_ns: int | None = None

    def snapshot(self) -> "Integrity":
        """A copy that no longer changes with the navigator."""
        return replace(self, excluded=dict(self.excluded))


@dataclass(frozen=True, slots=True, eq=False)
class Health(Measurement):
    """What a navigator says of itself beside its solution of the same stamp.

    Attributes
    ----------
    mode : str
    level : int
        0 healthy, 1 degraded, 2 failed, as diagnostic_msgs numbers them.
    reason : str
        One sentence.
    restarts : int
        How often it began anew, or took its position anew from a source that it had rejected, since its process began.
    contradictions : int
        How many contradictions last.
    """

    mode: str
    level: int
    reason: str
    restarts: int
    contradictions: int


class States(Mapping[str, tuple[float, float]]):
    """Named scalars with their sigmas; kept as ``values`` (n,) and ``variances`` (n,), since few of them are ever looked at."""

    __slots__ = ("_labels", "_values", "_variances")

    def __init__(self, labels: tuple[str, ...], values: np.ndarray, variances: np.ndarray) -> None:
        self._labels, self._values, self._variances = labels, values, variances

    def __iter__(self) -> Iterator[str]:
        return iter(self._labels)

    def __len__(self) -> int:
        return len(self._labels)

    def __getitem__(self, label: str) -> tuple[float, float]:
        if label not in self._labels:
            raise KeyError(label)
        k = self._labels.index(label)
        return float(self._values[k]), math.sqrt(max(float(self._variances[k]), 0.0))


@dataclass(frozen=True, slots=True, eq=False)
class NavSolution(Measurement):
    """The state a navigator reports; ``source`` is the navigator's name.

    What a navigator does not estimate is None, never NaN (an AHRS has no position; a dead reckoner may lack wind).

    Attributes
    ----------
    lat, lon, height : float or None
        Rad, rad, m above the ellipsoid.
    vel_n : ndarray (3,) or None
        m/s, NED.
    q_nb : ndarray (4,) or None
    angular_rate_b, specific_force_b : ndarray (3,)
        Bias-corrected, FRD.
    cov_pos, cov_vel, cov_att : ndarray (3, 3) or None
        NED, m^2, (m/s)^2, rad^2.
    wind_n : ndarray (2,) or None
        North, east components of the air mass's velocity.
    cov_wind : ndarray (2, 2) or None
    mode : str
        One lower-case word, the navigator's mode.
    states : mapping of str to (float, float)
        Further named scalars with their sigma, units in the names (``gyro_bias_x_radps``).
    integrity : Integrity or None
        Of a navigator that tests its satellites.
    health : Health or None
        What the navigator says of itself, where that has changed, or a second has passed since it last said so.
    """

    lat: float | None = None
    lon: float | None = None
    height: float | None = None
    vel_n: np.ndarray | None = None
    q_nb: np.ndarray | None = None
    angular_rate_b: np.ndarray | None = None
    specific_force_b: np.ndarray | None = None
    cov_pos: np.ndarray | None = None
    cov_vel: np.ndarray | None = None
    cov_att: np.ndarray | None = None
    wind_n: np.ndarray | None = None
    cov_wind: np.ndarray | None = None
    mode: str = ""
    states: Mapping[str, tuple[float, float]] | None = None
    integrity: Integrity | None = None
    health: Health | None = None

    @property
    def has_position(self) -> bool:
        """Whether it has a position with its covariance; only then do the following properties mean anything."""
        return self.lat is not None and self.cov_pos is not None

    @property
    def place(self) -> tuple[float, float, float]:
        """Lat, lon, height."""
        return cast("tuple[float, float, float]", (self.lat, self.lon, self.height))

    @property
    def place_cov(self) -> np.ndarray:
        """Covariance (3, 3) of the position, m^2 NED."""
        return cast("np.ndarray", self.cov_pos)

    @property
    def horizontal_sigma_m(self) -> float:
        """Estimated horizontal error, m: root of the sum of both variances."""
        return math.sqrt(self.place_cov[0, 0] + self.place_cov[1, 1])
