"""Recorded tables (CSV, gzip, whitespace columns) to a standard recording, by a YAML profile that names columns, units and frames."""

from lowcostnav_ros.convert.convert import ConversionReport, convert
from lowcostnav_ros.convert.profile import ConvertError, Profile, load_profile

__all__ = ["ConversionReport", "ConvertError", "Profile", "convert", "load_profile"]
