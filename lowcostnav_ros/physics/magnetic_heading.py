"""Heading from a three-axis magnetometer: pure functions of attitude, field and declination, shared by all navigators.

The field turned into n by the estimated attitude, ``B_n = C_nb B_b``, must point ``declination`` east of true north.  Only its azimuth
is used: the dip of the field adds nothing: iron in the aircraft disturbs it more.  With ``C_true = (I + [phi x]) C_est``

    y = D - atan2(B_E, B_N),        y = h phi,        h = [-B_N B_D / H^2, -B_E B_D / H^2, 1],        H^2 = B_N^2 + B_E^2

so a tilt error enters the heading with the tangent of the dip (Gebre-Egziabher 2004, section 3.2: levelled heading, equation 3.48).
"""

import math
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.small_matrices import matvec
from lowcostnav_ros.physics.geomagnetism import HIGHEST_HEIGHT, LOWEST_HEIGHT, DatedModel, MagneticModel, declination_of
from lowcostnav_ros.physics.rotation import wrap, wrap_2pi

STRENGTH_TOLERANCE = 0.2
"""Largest share by which the strength of the measured field may differ from the model's before it counts as interference."""
WEAKEST, STRONGEST = 15.0e-6, 80.0e-6
"""Strength of the earth's field at flight heights, tesla, widened; all that can be tested where the place is unknown."""


@kernel
def magnetic_innovation(C_nb, field_b, declination):
    """Heading innovation of a magnetometer and its row on the attitude error.

    Parameters
    ----------
    C_nb : ndarray, shape (3, 3)
        Estimated attitude.
    field_b : ndarray, shape (3,)
        Measured field, FRD, any unit.
    declination : float
        Rad, east positive.

    Returns
    -------
    y : float
        Measured minus estimated heading, rad, in (-pi, pi].
    h : ndarray, shape (3,)
        Derivative of ``y`` by ``phi_n``.
    horizontal : float
        Horizontal strength, unit of the field; ``y`` and ``h`` are zero when it is zero.
    """
    field_n = matvec(C_nb, field_b)
    h = np.zeros(3)
    squared = field_n[0] ** 2 + field_n[1] ** 2
    if squared <= 0.0:
        return 0.0, h, 0.0
    h[0] = -field_n[0] * field_n[2] / squared
    h[1] = -field_n[1] * field_n[2] / squared
    h[2] = 1.0
    return wrap(declination - math.atan2(field_n[1], field_n[0])), h, math.sqrt(squared)


@kernel
def magnetic_heading(roll, pitch, field_b, declination):
    """True heading, rad in [0, 2 pi), from a field levelled by roll and pitch (Gebre-Egziabher 2004, section 3.2).

    Parameters
    ----------
    roll, pitch : float
        Rad.
    field_b : ndarray, shape (3,)
        FRD, any unit.
    declination : float
        Rad, east positive.
    """
    sr, cr, sp, cp = math.sin(roll), math.cos(roll), math.sin(pitch), math.cos(pitch)
    ahead = field_b[0] * cp + field_b[1] * sr * sp + field_b[2] * cr * sp
    right = field_b[1] * cr - field_b[2] * sr
    return wrap_2pi(math.atan2(-right, ahead) + declination)


@dataclass(frozen=True, slots=True)
class LocalField:
    """What is expected of the field at one place.

    Attributes
    ----------
    declination : float
        Rad, east positive.
    strength : float or None
        Tesla; None where the place is unknown and only the declination was given.
    """

    declination: float
    strength: float | None = None

    def refusal(self, field_b: np.ndarray) -> str:
        """Reason not to use a measured field (3,), tesla: not the earth's strength; empty when it is."""
        measured = float(np.linalg.norm(field_b))
        if not math.isfinite(measured):
            return "magnetic field not finite"
        if self.strength is None:
            if WEAKEST <= measured <= STRONGEST:
                return ""
            return f"magnetic interference or wrong unit: field of {1e6 * measured:.3g} uT is not the earth's"
        if abs(measured / self.strength - 1.0) <= STRENGTH_TOLERANCE:
            return ""
        return f"magnetic interference: field is {measured / self.strength:.2f} of the model's {1e6 * self.strength:.1f} uT"


class MagneticReference:
    """Declination and strength of the earth's field: from the magnetic model, or the declination given by hand.

    Parameters
    ----------
    decimal_year : float
        Date for the model; 0: that of the stamps (:meth:`follow`).
    declination_deg : list of float
        Empty for the model; one number, east positive, overrides its declination (zero is a value like any other).

    Raises
    ------
    ValueError
        For more than one declination, or a date no model covers.
    """

    def __init__(self, decimal_year: float, declination_deg: list) -> None:
        if len(declination_deg) > 1:
            raise ValueError(f"Give one declination in degrees or an empty list for the magnetic model, got {list(declination_deg)}.")
        self.override = math.radians(declination_deg[0]) if declination_deg else None
        try:
            self.dated: DatedModel | None = DatedModel(decimal_year)
        except ValueError:
            if self.override is None:
                raise
            self.dated = None  # a declination by hand needs no model; only the test of the field strength is lost

    @property
    def model(self) -> MagneticModel | None:
        """The model of the date; None where there is none."""
        return None if self.dated is None else self.dated.model

    @property
    def remark(self) -> str:
        """What is odd about the date of the model, in words; empty for nothing."""
        return "" if self.dated is None else self.dated.remark

    def follow(self, stamp_ns: int) -> None:
        """Take the date of the model from a stamp, ns, unless the settings state it."""
        if self.dated is not None:
            self.dated.follow(stamp_ns)

    @property
    def source(self) -> str:
        """Where the declination comes from, for people."""
        return f"{self.model.name} {self.model.year:.1f}" if self.override is None and self.model else "given by hand"

    def field_n(self, lat: float, lon: float, height: float) -> np.ndarray | None:
        """Expected field (3,), tesla, NED, at a place: rad, rad, m above the ellipsoid; None where no model covers the date."""
        if self.model is None:
            return None
        field: np.ndarray = self.model.field_n(lat, lon, min(max(height, LOWEST_HEIGHT), HIGHEST_HEIGHT))
        if self.override is not None:
            level = float(np.hypot(field[0], field[1]))
            field = np.array([level * np.cos(self.override), level * np.sin(self.override), field[2]])
        return field

    def at(self, lat: float, lon: float, height: float) -> LocalField | None:
        """Expected field at a place: rad, rad, m above the ellipsoid; None where no model covers the date and none is given."""
        if self.model is None:
            return self.anywhere()
        field_n = self.model.field_n(lat, lon, min(max(height, LOWEST_HEIGHT), HIGHEST_HEIGHT))
        declination = declination_of(field_n) if self.override is None else self.override
        return LocalField(declination, float(np.linalg.norm(field_n)))

    def anywhere(self) -> LocalField | None:
        """Expected field where the place is unknown: the declination given by hand, or None."""
        return None if self.override is None else LocalField(self.override)


class FieldAtPlace:
    """Expected field at the place last known, for a navigator that does not estimate its position.

    Attributes
    ----------
    place : (lat, lon, height) or None
        Rad, rad, m above the ellipsoid.
    """

    def __init__(self, reference: MagneticReference, place: tuple[float, float, float] | None) -> None:
        self.reference, self.place = reference, place

    @property
    def remark(self) -> str:
        """What is odd about the date of the model."""
        return self.reference.remark

    def follow(self, stamp_ns: int) -> None:
        """Take the date of the model from a stamp, ns."""
        self.reference.follow(stamp_ns)

    def known(self) -> LocalField | None:
        """Expected field, or None when neither the place nor a declination is known."""
        return self.reference.anywhere() if self.place is None else self.reference.at(*self.place)

    def field_n(self, *_guess: float) -> np.ndarray | None:
        """Expected field (3,), tesla, NED, or None where the place or the model is missing; the host's guess of the place is not used."""
        return None if self.place is None else self.reference.field_n(*self.place)

    def at(self, lat: float, lon: float, height: float) -> LocalField | None:
        """The same; the position asked about is the host's guess and is not used."""
        return self.known()
