"""The worst outage in a sentence: which part of the error is the largest, and what happened."""

from lowcostnav_ros.studies.outages.result import End, Flown

_NAMES = {
    "loss": "the error at the loss",
    "wind": "the wind",
    "airspeed": "the airspeed",
    "heading": "the heading",
    "velocity": "the velocity at the loss",
    "rest": "corrections by other aids and the rest",
}
_CIRCUMSTANCES = {
    "wind": ("wind_change_mps", "it changed by {:.1f} m/s"),
    "airspeed": ("airspeed_error_mps", "off by {:+.1f} m/s"),
    "heading": ("heading_error_deg", "off by {:+.1f} deg on average"),
}
SMALL = 0.1
"""Parts below this share of the error are not named."""


def worst_sentence(flown: Flown, length_s: float) -> str:
    """Return what was worst at the end of one length and why; empty where there is nothing.

    Parameters
    ----------
    flown : Flown
    length_s : float
    """
    ends = flown.ends(length_s)
    if not ends:
        return ""
    outage, end = max(ends, key=lambda pair: pair[1].horizontal_m)
    sentence = f"{flown.label}: worst of {length_s:g} s is the loss at {outage.after_s:.0f} s, {end.horizontal_m:.0f} m off"
    sentence += f" ({end.horizontal_m / end.sigma_m:.1f} sigma)" if end.sigma_m > 0.0 else ""
    return f"{sentence}{because(end)}."


def because(end: End) -> str:
    """Return the parts of an error in words, the largest first."""
    parts = sorted(end.parts_m.items(), key=lambda item: -item[1])
    named = [(name, metres) for name, metres in parts if abs(metres) >= SMALL * end.horizontal_m]
    if not named:
        return ""
    (first, most), others = named[0], named[1:]
    inertial = "velocity" in end.parts_m
    texts = [_part(first, most, end, inertial), *(_part(name, metres, end, inertial) for name, metres in others)]
    turned = end.circumstances.get("turned_deg", 0.0)
    way = f"; {turned:.0f} deg of turns" if turned >= 30.0 else "; flown straight on"
    return f", mostly {texts[0]}{''.join(f', {text}' for text in texts[1:])}{way}"


def _part(name: str, metres: float, end: End, inertial: bool) -> str:
    part = "tilt and accelerometers" if inertial and name == "rest" else _NAMES[name]
    key, form = _CIRCUMSTANCES.get(name, ("", ""))
    why = f" ({form.format(end.circumstances[key])})" if key in end.circumstances else ""
    return f"{part} {metres:+.0f} m{why}"
