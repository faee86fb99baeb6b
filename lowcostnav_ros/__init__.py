"""Low-cost aircraft navigation, with GPS and without: the glossary that every file obeys.

Frames
------
i : inertial.  e : earth-centred earth-fixed (ECEF), WGS-84.
n : local level **North, East, Down** at the current position.
b : body, **forward, right, down** (FRD).
ENU and FLU exist only in ROS messages and are converted in one place, :mod:`lowcostnav_ros.messages.conversions`.

Letters
-------
``vel_n``            velocity over ground resolved in n, m/s
``C_nb``, ``q_nb``   rotation that takes b-coordinates to n-coordinates; Hamilton quaternion, scalar first, unit norm
``specific_force_b`` what accelerometers measure, f = a - g; level and at rest it is (0, 0, -9.81) m/s^2
``angular_rate_b``   rate of b relative to i resolved in b, rad/s
``wind_n``           velocity OF the air mass over ground, m/s (a wind from the west is +east)
``lat``, ``lon``     geodetic, radians (``lat_deg`` only at the edges); ``height`` metres above the ellipsoid
``heading``          true, clockwise from north; magnetic only where the name says so; east declination is positive
``stamp_ns``         time of validity, integer nanoseconds; estimators know no other clock

Errors
------
An error state is **true minus estimated** for everything additive, so an estimate is corrected by adding it:
``vel_true = vel_est + dv``; position errors are metres north, east, down.  The attitude error is the small rotation
``phi_n``, resolved in n, with ``C_nb_true = (I + [phi_n x]) C_nb_est``.  An innovation is measured minus predicted.

Units are SI and radians.  A name carries its unit where a doubt is possible (``_deg``, ``_kt``, ``_ft``, ``_nm``).
"""

__version__ = "0.1.0"
