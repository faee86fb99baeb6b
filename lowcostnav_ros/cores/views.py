"""What aids see of a core: small typed views.  A core that lacks one cannot take the aids that ask for it: their constructor refuses it."""

from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np


class Motion(NamedTuple):
    """Place (lat, lon [rad], height [m]), velocity (3,) m/s NED, attitude, and their covariance (9, 9), m, m/s, rad; zero: not its own."""

    place: tuple[float, float, float]
    vel_n: np.ndarray
    q_nb: np.ndarray
    P: np.ndarray


@runtime_checkable
class Place(Protocol):
    """A position.

    ``nav`` begins with lat, lon [rad], height [m]; the first three error states are metres north, east, down.  ``speed_mps`` is over
    ground or through the air; ``ranging`` (n,) the states that a range or a bearing may move, None: all.
    """

    nav: np.ndarray
    estimate: np.ndarray
    ranging: np.ndarray | None

    @property
    def speed_mps(self) -> float: ...

    def lever_n(self, lever_b: np.ndarray) -> np.ndarray:
        """Lever arm (3,), m, turned to n."""

    def height_residual(self, height: float, bias: float) -> float:
        """A height, m, less the estimated one and an estimated bias."""


class VelocitySeen(NamedTuple):
    """Velocity predicted at an antenna.

    ``vel_n`` (3,) of the IMU, ``swing_n`` (3,) what the lever arm adds, m/s NED; ``H`` (3, n) Jacobian of their sum; ``noise`` (3, 3) what
    the states do not explain, None: nothing; ``turns`` (3,) 1 where it follows the velocity that carries the core and is no state.
    """

    vel_n: np.ndarray
    swing_n: np.ndarray
    H: np.ndarray
    noise: np.ndarray | None = None
    turns: np.ndarray | None = None


@runtime_checkable
class Velocity(Protocol):
    """A velocity over ground.

    ``velocity_rows`` are its states, None where it follows from other states.
    """

    velocity_rows: slice | None

    def velocity_at(self, lever_b: np.ndarray) -> VelocitySeen | str:
        """Velocity of an antenna, or the reason why it is not known."""


@runtime_checkable
class Attitude(Protocol):
    """An attitude with its error as states.

    ``attitude_rows`` are its states phi_n [rad].
    """

    attitude_rows: slice
    nav: np.ndarray
    estimate: np.ndarray

    def C_nb(self) -> np.ndarray:
        """Rotation (3, 3) from b to n."""


@runtime_checkable
class AirMass(Protocol):
    """A wind as states.

    ``wind_rows`` (2, n) sum what makes up the wind, north and east.
    """

    wind_rows: np.ndarray

    def wind_n(self) -> np.ndarray:
        """Estimated wind (2,), m/s, north and east."""
