"""Weather at a ground station: what of it can be right, the standard atmosphere in its place, and the refractivity of the air.

Refractivity N is in N-units, (n - 1) 1e6; dry and wet parts are kept apart because they fall differently with height.

References
----------
Kawecki (2015), AFIT-ENG-MS-15-M-025: equations (3.12), (3.13), (3.18), (3.19).  The pressure of (3.12) is hectopascal, not millimetres of
mercury as printed, and the humidity of (3.13) is in percent.
"""

from dataclasses import dataclass

from lowcostnav_ros.base.units import kelvin
from lowcostnav_ros.physics import atmosphere

STANDARD_HUMIDITY = 0.5
UNLIKE = 0.12
"""Share by which a pressure may differ from that of the standard atmosphere at the station's height: storms make 6 %."""
HPA_PER_MMHG = 1.333224
SCALE = 1e-6


@dataclass(frozen=True, slots=True)
class Weather:
    """Static pressure ``pressure_pa``, temperature ``temperature_k`` and relative humidity ``humidity`` (0 to 1) at a place."""

    pressure_pa: float
    temperature_k: float
    humidity: float

    def absurdity(self, height: float) -> str:
        """Why it cannot be the weather at a height (m above the ellipsoid), in words; empty when it can."""
        hpa, usual_hpa = 0.01 * self.pressure_pa, 0.01 * standard_weather(height).pressure_pa
        if not kelvin(-90.0) <= self.temperature_k <= kelvin(60.0):  # also NaN
            kelvin_too = kelvin(-90.0) <= self.temperature_k - kelvin(0.0) <= kelvin(60.0)
            return f"temperature of {self.temperature_k - kelvin(0.0):.0f} degC" + (": kelvin instead of degC?" if kelvin_too else "")
        if not 0.0 <= self.humidity <= 1.05:
            return f"relative humidity of {100.0 * self.humidity:.0f} %"
        if not abs(hpa / usual_hpa - 1.0) <= UNLIKE:
            text = f"pressure of {hpa:.0f} hPa where {usual_hpa:.0f} hPa is usual at {height:.0f} m"
            if abs(hpa * HPA_PER_MMHG / usual_hpa - 1.0) <= UNLIKE:
                return f"{text}: millimetres of mercury instead of hPa?"
            return f"{text}: check pressure and height"
        return ""

    def vapour_hpa(self) -> float:
        """Partial pressure of water vapour, hPa, as (3.13) has it."""
        return self.humidity * 6.11 * 10.0 ** (7.4475 * (self.temperature_k - 273.0) / (self.temperature_k - 38.3))

    def dry(self) -> float:
        """N_dry = 77.6 P/T (3.12)."""
        return 77.6 * 0.01 * self.pressure_pa / self.temperature_k

    def wet(self) -> float:
        """N_wet = 22770 f/T^2 10^(7.4475 (T - 273)/(T - 38.3)), f in percent (3.13)."""
        exponent = 7.4475 * (self.temperature_k - 273.0) / (self.temperature_k - 38.3)
        return 22770.0 * 100.0 * self.humidity / self.temperature_k**2 * 10.0**exponent

    def index(self) -> float:
        """N of the index-of-refraction model, (3.18) + (3.19), with the partial pressure of dry air."""
        e, T = self.vapour_hpa(), self.temperature_k
        return 77.689 * (0.01 * self.pressure_pa - e) / T + 71.2962 * e / T + 375463.0 * e / T**2


def standard_weather(height: float) -> Weather:
    """The standard atmosphere at a height, m, taken for one above mean sea level, and half the humidity there can be."""
    altitude = float(atmosphere.geopotential_altitude(height))
    return Weather(float(atmosphere.pressure(altitude)), float(atmosphere.temperature(altitude)), STANDARD_HUMIDITY)
