"""Two sources that cannot both be right: a state with a name, the two parties, its size and since when."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Contradiction:
    """One contradiction that lasts.

    Attributes
    ----------
    name : str
        Fixed phrase to count by: ``position and velocity disagree``.
    parties : tuple of str
        The two sources, topics or aids, that disagree; the second may be the navigator's own prediction or a physical law.
    size : float
        How far they are apart, in ``unit``.
    unit : str
    since_ns : int
        Stamp at which it began.
    suspect : str
        The party that others speak against, or empty where nobody can tell.
    advice : str
        What to look at or to set, for people; empty for nothing.
    """

    name: str
    parties: tuple[str, str]
    size: float
    unit: str
    since_ns: int
    suspect: str = ""
    advice: str = ""

    def words(self, now_ns: int) -> str:
        """One sentence for people: ``position and velocity disagree: gps/fix and gps/vel, 49.8 m/s for 12 s; suspect: gps/fix``."""
        lasted_s = 1e-9 * (now_ns - self.since_ns)
        text = f"{self.name}: {self.parties[0]} and {self.parties[1]}, {self.size:.3g} {self.unit} for {lasted_s:.0f} s"
        text += f"; suspect: {self.suspect}" if self.suspect else ""
        return f"{text}; {self.advice}" if self.advice else text
