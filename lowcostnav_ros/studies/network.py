"""A skeletal DME network for 200 airports: printed counts with what does not add up, equipment cost.

Gebre-Egziabher 2004, sections 2.6 and 2.7: Table 2.1 and figure 2.13.  The counts of options I and II are inconsistent as printed and
are kept so, with a remark.
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Option:
    """One option: ``fold`` stations in view down to ``above_ground_ft``; printed ``total``, ``existing`` and ``additional`` sites."""

    name: str
    fold: int
    above_ground_ft: float
    total: int
    existing: int
    additional: int

    @property
    def gap(self) -> int:
        """Printed total minus the sum of its printed parts; 0 when they agree."""
        return self.total - self.existing - self.additional

    @property
    def remark(self) -> str:
        """What does not add up, empty when everything does."""
        if self.gap == 0:
            return ""
        parts = f"{self.existing} + {self.additional} = {self.existing + self.additional}, not {self.total}"
        implied = f"{self.total - self.additional} existing or {self.total - self.existing} additional would"
        return f"option {self.name}: {parts}; {implied}"


OPTIONS = (
    Option("I", 2, 1500.0, 318, 273, 25),
    Option("II", 2, 500.0, 356, 356, 32),
    Option("III", 3, 1500.0, 442, 366, 76),
    Option("IV", 3, 500.0, 512, 393, 119),
)


@dataclass(frozen=True, slots=True)
class Cost:
    """One line of Table 2.1: price in USD where the sensor alone is counted and where the certified box is bought."""

    item: str
    sensor_usd: float
    consumer_usd: float


COSTS = (
    Cost("GPS receiver (carried already)", 0.0, 0.0),
    Cost("DME receiver (carried already)", 0.0, 0.0),
    Cost("AHRS", 1500.0, 10_000.0),
    Cost("computer", 500.0, 3000.0),
)


def total_cost() -> Cost:
    """Return the sum of Table 2.1."""
    return Cost("total", sum(c.sensor_usd for c in COSTS), sum(c.consumer_usd for c in COSTS))
