"""RINEX text written column by column from the format's tables: records, epochs, and whole recordings of a known receiver."""

import math

import numpy as np

from lowcostnav_ros.gnss import gps_time as gt
from lowcostnav_ros.gnss import troposphere
from lowcostnav_ros.gnss.constellation import gps_24
from lowcostnav_ros.gnss.ephemeris import ORBIT_EARTH_RATE, Ephemeris, satellite_state
from lowcostnav_ros.gnss.observables import azimuth_elevation, line_of_sight, turned
from lowcostnav_ros.gnss.signals import L1_WAVELENGTH_M, SPEED_OF_LIGHT, name
from lowcostnav_ros.physics.earth import ecef_to_geodetic

DAY = gt.from_calendar(2005, 4, 2)
TOE = DAY + 3600 * gt.SECOND


def head(label, content=""):
    return f"{content:<60}{label:<20}"


def start(version, kind, *more):
    return [head("RINEX VERSION / TYPE", f"{version:9.2f}{'':11}{kind}"), *more, head("END OF HEADER")]


def d19(value):
    """Fortran's D19.12."""
    return f"{value:19.12E}".replace("E", "D")


def record(e: Ephemeris, version, *, week=None, health=0.0, source=1.0, ura=2.0):
    """One navigation record; the date is that of the clock, 2005-04-02 with the hour of toc."""
    week_, toe = gt.week_and_tow(e.toe_ns)
    hour = round(gt.week_and_tow(e.toc_ns)[1] - 518400.0) // 3600
    name = f"{e.sat_id:2d} 05  4  2 {hour:2d}  0  0.0" if version < 3 else f"{e.system}{e.sat_id:02d} 2005 04 02 {hour:02d} 00 00"
    delays = (e.group_delay_s, 7.0) if e.system == "G" else (9e-9, e.group_delay_s)
    rows = [
        (e.issue, e.crs, e.motion_correction, e.mean_anomaly),
        (e.cuc, e.eccentricity, e.cus, e.sqrt_a),
        (toe, e.cic, e.node, e.cis),
        (e.inclination, e.crc, e.perigee, e.node_rate),
        (e.inclination_rate, source, week_ if week is None else week, 0.0),
        (ura, health, *delays),
        (toe - 30.0,),
    ]
    pad = " " * (3 if version < 3 else 4)
    return [name + "".join(d19(v) for v in (e.af0, e.af1, e.af2)), *(pad + "".join(d19(v) for v in row) for row in rows)]


TYPES_2 = head("# / TYPES OF OBSERV", f"{6:6d}" + "".join(f"{t:>6}" for t in ("L1", "C1", "L2", "P2", "D1", "S1")))
INTERVAL = head("INTERVAL", f"{30.0:10.3f}")


def epoch_2(seconds, sats, flag=0, values=None):
    """An epoch of version 2 with six observation types on two lines a satellite."""
    names = [sats[k : k + 12] for k in range(0, len(sats), 12)] or [[]]
    minute, second = divmod(seconds, 60.0)
    lines = [f" 05  4  2  0 {int(minute):2d}{second:11.7f}  {flag}{len(sats):3d}" + "".join(names[0])]
    lines += [" " * 32 + "".join(more) for more in names[1:]]
    for k, _ in enumerate(sats):
        c1, d1, s1 = (values or {}).get(k, (2.2e7 + k, -1000.0 + k, 45.0))
        cells = [f"{v:14.3f}  " if v is not None else " " * 16 for v in (1e7, c1, None, 2.2e7, d1, s1)]
        lines += ["".join(cells[:5]).rstrip(), cells[5].rstrip()]
    return lines


def ephemerides(unhealthy=()):
    """The satellites of Table 6.1 and eight more between them, with clocks of their own, valid until two hours after ``TOE``."""
    gps = gps_24()
    numbers = np.arange(1, 33)
    argument, node = (np.concatenate((column, column[::3] + more)) for column, more in ((gps.argument, 1.0), (gps.node, 0.0)))
    toe_s = gt.week_and_tow(TOE)[1]
    node, root = np.mod(node + ORBIT_EARTH_RATE * toe_s, 2.0 * math.pi), math.sqrt(gps.radius_m[0])
    columns = zip(numbers.tolist(), np.mod(argument, 2.0 * math.pi).tolist(), node.tolist(), strict=True)
    orbits = ((k, (root, 0.0, at, ascending, float(gps.inclination[0]), 0.0, 0.0)) for k, at, ascending in columns)
    return [Ephemeris("G", k, TOE, TOE, *orbit, af0=1e-5 * k, af1=1e-11, healthy=k not in unhealthy) for k, orbit in orbits]


def yuma_text(satellites, weeks=292):
    """A YUMA almanac of the same orbits."""
    def block(e):
        week, toe_s = gt.week_and_tow(e.toe_ns)
        return "\n".join([
            f"******** Week {weeks} almanac for PRN-{e.sat_id:02d} ********", f"ID:                         {e.sat_id:02d}",
            f"Health:                     {0 if e.healthy else 63:03d}", f"Eccentricity:               {e.eccentricity:.10E}",
            f"Time of Applicability(s):  {toe_s:.4f}", f"Orbital Inclination(rad):   {e.inclination:.10f}",
            f"Rate of Right Ascen(r/s):   {e.node_rate:.10E}", f"SQRT(A)  (m 1/2):           {e.sqrt_a:.6f}",
            f"Right Ascen at Week(rad):   {e.node:.10E}", f"Argument of Perigee(rad):   {e.perigee:.9f}",
            f"Mean Anom(rad):             {e.mean_anomaly:.10E}", f"Af0(s):                     {e.af0:.10E}",
            f"Af1(s/s):                   {e.af1:.10E}", f"week:                       {weeks}", "",
        ])  # fmt: skip

    return "\n".join(block(e) for e in satellites)


def navigation_text(satellites, version=2.11):
    """A navigation file."""
    records = [record(e, version, health=0.0 if e.healthy else 63.0) for e in satellites]
    return "\n".join(start(version, "N") + sum(records, []))


def pseudorange(satellite, gps, position_e, clock_m):
    """Pseudorange, m, at a time of validity, GPS time, ns, with troposphere, and the elevation, rad."""
    flight_s = 0.07
    for _ in range(4):
        state = satellite_state(satellite, gps - round(flight_s * gt.SECOND))
        seen = turned(state.position_e[None], np.array([7.292115e-5 * flight_s]))
        ranges, los = line_of_sight(position_e, seen)
        flight_s = float(ranges[0]) / SPEED_OF_LIGHT
    lat, lon, height = ecef_to_geodetic(position_e)
    elevation = azimuth_elevation(lat, lon, los)[1]
    delay = troposphere.delay_m(lat, height, elevation, troposphere.day_of_year(gps))[0] if elevation[0] > math.radians(2.1) else 0.0
    return float(ranges[0]) + clock_m - SPEED_OF_LIGHT * state.clock_s + delay, float(elevation[0])


def seen_at(satellites, tag_s, position_e, clock_m, lowest_deg=10.5, drift_mps=0.0):
    """Code, m, and Doppler, Hz, by satellite at a tag of the receiver's clock, s of the day."""
    gps = DAY + round(tag_s * gt.SECOND) - round(clock_m / SPEED_OF_LIGHT * gt.SECOND)
    seen = {}
    for one in satellites:
        code, elevation = pseudorange(one, gps, position_e, clock_m)
        if math.degrees(elevation) >= lowest_deg:
            later, earlier = (pseudorange(one, gps + step, position_e, clock_m)[0] for step in (gt.SECOND // 2, -gt.SECOND // 2))
            seen[name(one.system, one.sat_id)] = code, -(later - earlier + drift_mps) / L1_WAVELENGTH_M
    return seen


def observation_text(epochs, position_e=None, interval_s=None, doppler=True):
    """An observation file of version 2 from (seconds within the first hour, {name: (code, Doppler)})."""
    more = [] if position_e is None else [head("APPROX POSITION XYZ", "".join(f"{x:14.4f}" for x in position_e))]
    more += [] if interval_s is None else [head("INTERVAL", f"{interval_s:10.3f}")]
    lines = start(2.11, "O", TYPES_2, *more)
    for seconds, seen in epochs:
        values = {k: (code, rate if doppler else None, 45.0) for k, (code, rate) in enumerate(seen.values())}
        lines += epoch_2(seconds, list(seen), values=values)
    return "\n".join(lines)
