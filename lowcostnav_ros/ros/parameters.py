"""ROS parameters from settings dataclasses: declared with description and range, validated, refused with the reason."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from lowcostnav_ros.base.settings import Declared, SettingsError, checked, chosen_class, declared, from_mapping, nearest, to_mapping

BUILT_IN = ("use_sim_time", "start_type_description_service", "qos_overrides")
LARGE = 1.0e300


class Parameters:
    """The parameters of one node.

    The node must have been made with ``automatically_declare_parameters_from_overrides=True``: so values from YAML files and the
    command line are read through the public interface, whole numbers are accepted where a number is meant, and a name that
    is not declared is refused instead of ignored.

    Parameters
    ----------
    node : rclpy.node.Node
    bases : sequence of settings objects
        One object per settings dataclass; its values are the defaults.  Where ``given`` chooses other groups (another list of sensors),
        the class that it chooses takes its place.
    given : mapping
        Values from outside, see :func:`given_parameters`.
    on_change : callable
        Called with the list of new settings objects after a live change.
    build : callable
        Makes settings of a class, values by dotted name and the name of the node; :func:`from_mapping` or one that looks up what they name.

    Raises
    ------
    SettingsError
        For an unknown name (the nearest known one is given), a wrong type or a value out of range.
    """

    def __init__(
        self, node: Node, bases: Sequence[Any], given: Mapping[str, Any], on_change: Callable[[list], None], build: Callable = from_mapping
    ) -> None:
        self._classes = [chosen_class(type(base), given) for base in bases]
        self._on_change, self._make = on_change, build
        self._known = _known(self._classes)
        self._where = node.get_name()
        own = {name: value for base in bases for name, value in to_mapping(base).items()}
        defaults = {name: own.get(name, entry.default) for name, entry in self._known.items()}
        for cls in self._classes:
            given = getattr(cls, "upgraded", dict)(dict(given))  # names of older files
        for name in given:
            if name not in self._known:
                raise SettingsError(f"{self._where}: unknown parameter '{name}'{nearest(name, self._known)}.")
        self._values = {**defaults, **{n: checked(self._known[n], v, self._where) for n, v in given.items()}}
        self.settings = self._build(self._values)
        for settings in self.settings:  # a parameter reads as the value in use
            self._values |= to_mapping(settings)
        for name, entry in self._known.items():
            if node.has_parameter(name):
                node.undeclare_parameter(name)
            node.declare_parameter(name, self._values[name], _descriptor(entry), ignore_override=True)
        node.add_on_set_parameters_callback(self._judge)
        node.add_post_set_parameters_callback(self._apply)

    @property
    def names(self) -> list[str]:
        """Names of all of them."""
        return list(self._known)

    def _build(self, values: Mapping[str, Any]) -> list:
        return [self._make(c, {d.name: values[d.name] for d in declared(c)}, self._where) for c in self._classes]

    def _changed(self, parameters: list[Parameter]) -> dict[str, Any]:
        return {p.name: checked(self._known[p.name], p.value, self._where) for p in parameters if p.name in self._known}

    def _judge(self, parameters: list[Parameter]) -> SetParametersResult:
        try:
            self._build({**self._values, **self._changed(parameters)})
        except SettingsError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _apply(self, parameters: list[Parameter]) -> None:
        changed = self._changed(parameters)
        if changed:
            self._values.update(changed)
            self.settings = self._build(self._values)
            self._on_change(self.settings)


def _known(classes: Sequence[type]) -> dict[str, Declared]:
    known: dict[str, Declared] = {}
    for cls in classes:
        for entry in declared(cls):
            if entry.name in known:
                raise SettingsError(f"{cls.__name__}: the setting '{entry.name}' is declared twice; rename one.")
            known[entry.name] = entry
    return known


def given_parameters(node: Node) -> dict[str, Any]:
    """Return the parameter values given from outside (files, command line, constructor), without those that ROS itself declares."""
    given: Mapping[str, Any] = node.get_parameters_by_prefix("")
    return {name: p.value for name, p in given.items() if name.split(".")[0] not in BUILT_IN}


def _descriptor(entry: Declared) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(
        description=f"[{entry.unit}] {entry.description}" if entry.unit else entry.description,
        read_only=not entry.live,
        # an empty list has no ROS type yet, and one number or three are two types
        dynamic_typing=entry.per_axis or (isinstance(entry.default, list) and not entry.default),
    )
    if entry.choices:
        descriptor.additional_constraints = "one of " + ", ".join(str(c) for c in entry.choices)
    sample = entry.default[0] if isinstance(entry.default, list) and entry.default else entry.default
    if (entry.minimum is None and entry.maximum is None) or isinstance(entry.default, list) or entry.per_axis:
        return descriptor
    low, high = (-LARGE if entry.minimum is None else entry.minimum), (LARGE if entry.maximum is None else entry.maximum)
    if isinstance(sample, int):
        limit = 2**62
        descriptor.integer_range = [IntegerRange(from_value=int(max(low, -limit)), to_value=int(min(high, limit)))]
    else:
        descriptor.floating_point_range = [FloatingPointRange(from_value=float(low), to_value=float(high))]
    return descriptor
