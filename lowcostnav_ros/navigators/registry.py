"""The navigators by name; imported lazily so that a node loads only its own."""

from collections.abc import Callable, Mapping
from importlib import import_module

from lowcostnav_ros.navigators.base import Navigator

_WHERE = {
    "ahrs": ("ahrs.navigator", "AhrsSettings", "Ahrs"),
    "dead_reckoning": ("dead_reckoning.navigator", "DeadReckoningSettings", "DeadReckoning"),
    "gnss_only": ("gnss_only", "GnssOnlySettings", "GnssOnly"),
    "ins_gnss": ("ins_gnss", "InsGnssSettings", "InsGnss"),
    "ins_gps": ("ins_gps", "InsGpsSettings", "InsGps"),
    "supervisor": ("supervisor.navigator", "SupervisorSettings", "Supervisor"),
}


class _Registry(Mapping[str, tuple[type, Callable[..., Navigator]]]):
    """Name to (settings class, navigator class), in the order in which one feeds the next."""

    def __getitem__(self, name: str) -> tuple[type, Callable[..., Navigator]]:
        module, settings, navigator = _WHERE[name]
        loaded = import_module(f"lowcostnav_ros.navigators.{module}")
        return getattr(loaded, settings), getattr(loaded, navigator)

    def __iter__(self):
        return iter(_WHERE)

    def __len__(self) -> int:
        return len(_WHERE)


NAVIGATORS = _Registry()
