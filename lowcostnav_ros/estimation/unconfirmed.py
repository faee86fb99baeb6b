"""An airspeed that changes while no GPS confirms it: how much of the change may be ice, water or a leak in the pitot tube.

Ice, a blocked drain, a cover: each shows as a change of the airspeed since GPS last confirmed it, and the inertial sensors follow a slow
one, because the airspeed itself levels them.  So the error of the airspeed is uncertain by a share of that change, beyond what gusts and
flying by hand do all the time.  Ranges and radials then correct the airspeed as well as the place.
"""

USUAL_MPS = 2.0
"""Changes well below this are gusts and flying by hand."""
MEMORY_S = 30.0
"""What an airspeed has been for so long is what its next change counts from: by then ranges may have learned its error."""


class UnconfirmedSpeed:
    """The airspeed that GPS confirmed last, and what has been allowed for its change since.

    Parameters
    ----------
    share : float
        Sigma of the airspeed as a share of its unconfirmed change.
    noise_mps : float
        Change that is noise, where the airspeed is taken as it is measured.
    """

    def __init__(self, share: float, noise_mps: float = 0.0) -> None:
        self._share, self._noise_mps = share, noise_mps
        self.clear()

    def clear(self) -> None:
        """Forget what was confirmed."""
        self._usual: float | None = None
        self._allowed, self._t_ns = 0.0, 0

    def doubt(self, speed: float) -> float:
        """Sigma, m/s, by which an airspeed may be off that has changed from what it was to ``speed``."""
        change = 0.0 if self._usual is None else max(abs(speed - self._usual) - self._noise_mps, 0.0)
        return self._share * change**2 / (change + USUAL_MPS)

    def take(self, stamp_ns: int, speed: float, *, confirmed: bool) -> float:
        """Take an airspeed, m/s; return the variance, (m/s)^2, that its error gains now."""
        faded = min(1e-9 * (stamp_ns - self._t_ns) / MEMORY_S, 1.0)
        self._t_ns = stamp_ns
        if confirmed or self._usual is None:
            self._usual, self._allowed = speed, 0.0
            return 0.0
        sigma = self.doubt(speed)
        self._usual += faded * (speed - self._usual)
        self._allowed *= 1.0 - faded
        gained = max(sigma**2 - self._allowed**2, 0.0)
        self._allowed = max(sigma, self._allowed)
        return gained
