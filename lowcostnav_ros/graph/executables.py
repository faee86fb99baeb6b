"""The executables by name: the nodes of ``nodes/``, one for every sensor simulator, one for every navigator, plugins included."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from lowcostnav_ros.base.registry import ClassRegistry, RegistryError
from lowcostnav_ros.base.settings import SettingsError, chosen_class, nearest
from lowcostnav_ros.catalogue.config_files import yaml_of
from lowcostnav_ros.navigators.registry import NAVIGATORS
from lowcostnav_ros.sensors.registry import SIMULATORS

KINDS = ("source", "driver", "simulator", "navigator", "node", "recorder", "monitor")
SOURCE, DRIVER, SIMULATOR, NAVIGATOR, NODE, RECORDER, MONITOR = KINDS
"""Kinds of executables, in the order in which a graph stops them: what feeds before what is fed, so that a recording is complete."""

_SUFFIX = "_simulator"


@dataclass(frozen=True)
class Executable:
    """One executable, as a node class describes itself in ``@executable("player", kind="source", Settings=PlayerSettings)``.

    ``kind`` is one of :data:`KINDS`; ``compiled`` is False where a process computes next to nothing: without the compiler it needs half the
    memory; ``inputs`` are the topics it is known to subscribe to, ``outputs`` those it makes for navigators of what they do not take: a
    graph in which nothing is known to publish them gets the node by itself.  The class is made without arguments; ``Settings``, if any,
    are those of its parameter file.
    """

    name: str
    kind: str = NODE
    compiled: bool = True
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()


NODES = ClassRegistry("node", "lowcostnav_ros.nodes", "executable", Executable)
executable = NODES.entry


class _Executables(Mapping[str, Executable]):
    def __getitem__(self, name: str) -> Executable:
        if name in NODES:
            return NODES.label(name)
        if name.removesuffix(_SUFFIX) in SIMULATORS and name.endswith(_SUFFIX):
            # one row of truth at a time, where compiled kernels gain nothing
            return Executable(name, SIMULATOR, compiled=False, inputs=SIMULATORS.label(sensor_of(name)).truth)
        if name in NAVIGATORS:
            return Executable(name, NAVIGATOR)
        raise RegistryError(f"There is no executable '{name}'{nearest(name, self)}.")

    def __contains__(self, name: object) -> bool:
        return name in set(self)

    def __iter__(self) -> Iterator[str]:
        return iter((*NODES, *(name + _SUFFIX for name in SIMULATORS), *NAVIGATORS))

    def __len__(self) -> int:
        return len(list(iter(self)))

    def own(self) -> tuple[str, ...]:
        """Names of the executables of this package, without those of plugins."""
        return (*NODES.own(), *(name + _SUFFIX for name in SIMULATORS.own()), *NAVIGATORS.own())


EXECUTABLES = _Executables()


def kind_of(name: str) -> str:
    """Return the kind of an executable, one of :data:`KINDS`."""
    return EXECUTABLES[name].kind


def sensor_of(name: str) -> str:
    """Return the sensor of a simulator's executable."""
    return name.removesuffix(_SUFFIX)


def needs_compiler(name: str) -> bool:
    """Whether the process of an executable needs compiled kernels; plugins are not imported to find out."""
    return not name.endswith(_SUFFIX) and (name not in NODES.own() or NODES.label(name).compiled)


def parameter_file(name: str, aids: Sequence[str] = ()) -> str:
    """Return the parameter file of an executable, every parameter with its meaning, unit and range; ``aids`` as a navigator's own list.

    Raises
    ------
    RegistryError
        When there is no such executable, or it has no parameters of its own.
    SettingsError
        When ``aids`` names what is no sensor, or the executable is no navigator with a list of them.
    """
    settings = settings_of(name)
    if settings is None:
        raise RegistryError(f"The executable '{name}' has no parameters of its own; every node has qos.lossless and input.silent_after_s.")
    if aids and not hasattr(settings, "chosen_by"):
        raise SettingsError(f"The executable '{name}' has no list of sensors; omit --aids.")
    return yaml_of(chosen_class(settings, {"aids": list(aids)}) if aids else settings)


def settings_of(name: str) -> type | None:
    """Return the settings dataclass of an executable's parameter file, None where it has none; imports the executable's module."""
    kind = kind_of(name)
    found = SIMULATORS[sensor_of(name)] if kind == SIMULATOR else NAVIGATORS[name] if kind == NAVIGATOR else NODES[name]
    return getattr(found, "Settings", None)
