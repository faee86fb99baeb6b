"""Bytes of receivers, autopilots and recorders to measurements: one parser a protocol, for a driver and for a converter alike.

A *stream* format is fed with bytes as they come (:mod:`~lowcostnav_ros.formats.parser`); a *log* format is read from a file in columns
(:mod:`~lowcostnav_ros.formats.log`).  Neither knows ROS, a clock or a port.
"""
