"""An airspeed that changes while no GPS confirms it: how much of the change may be ice, water or a leak in the pitot tube.

Ice, a blocked drain, a cover: each shows as a change of the airspeed since GPS last confirmed it, and the inertial sensors follow a slow
one, because the airspeed itself levels them.  So the error of the airspeed is uncertain by a share of that change, beyond what gusts and
flying by hand do all the time.  Ranges and radials then correct the airspeed as well as the place.
"""

USUAL_MPS = 3.0
"""Changes up to this are gusts and flying by hand."""


class UnconfirmedSpeed:
    """The airspeed that GPS confirmed last, and what has been allowed for its change since.

    Parameters
    ----------
    share : float
        Sigma of the airspeed as a share of its unconfirmed change.
    """

    def __init__(self, share: float) -> None:
        self._share = share
        self.clear()

    def clear(self) -> None:
        """Forget what was confirmed."""
        self._confirmed: float | None = None
        self._allowed = 0.0

    def take(self, speed: float, *, confirmed: bool) -> float:
        """Take an airspeed, m/s, free of its noise; return the variance, (m/s)^2, that its error gains now."""
        if confirmed or self._confirmed is None:
            self._confirmed, self._allowed = speed, 0.0
            return 0.0
        sigma = self._share * max(abs(speed - self._confirmed) - USUAL_MPS, 0.0)
        gained = max(sigma**2 - self._allowed**2, 0.0)
        self._allowed = max(sigma, self._allowed)
        return gained
