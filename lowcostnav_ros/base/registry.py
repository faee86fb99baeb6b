"""Registries: a thing is described once, where it is defined, and found by its name.

A registry looks in a room: every module of the room is one entry and registers itself when it is imported, which happens only when that
entry is asked for.  What stands outside this package is named by the environment variable ``LOWCOSTNAV_PLUGINS``, modules separated by
commas: they are imported before the first look-up and register what they define in the same way.
"""

import importlib
import os
import pkgutil
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from typing import Generic, TypeVar

from lowcostnav_ros.base.settings import nearest

T = TypeVar("T")

PLUGINS = "LOWCOSTNAV_PLUGINS"
"""Environment variable that names modules to import, separated by commas."""


class RegistryError(ValueError):
    """A name that is not registered, or registered twice; the message is one sentence that says what exists."""


class Registry(Mapping[str, T], Generic[T]):
    """Things by name.

    Parameters
    ----------
    what : str
        What one thing is called in a refusal (``navigator``).
    room : str
        Package whose modules are the entries; the name of a module is the name of its entry.
    hidden : tuple of str
        Modules of the room that are no entries.
    """

    def __init__(self, what: str, room: str, hidden: tuple[str, ...] = ()) -> None:
        self.what, self.room, self.hidden = what, room, hidden
        self._things: dict[str, T] = {}
        self._origins: dict[str, str] = {}

    def register(self, name: str, thing: T, origin: str) -> T:
        """Enter a thing; ``origin`` is the module that defines it and may enter it again (when it is imported twice).

        Raises
        ------
        RegistryError
            When another module has entered one of this name.
        """
        if self._origins.setdefault(name, origin) != origin:
            raise RegistryError(f"Two modules define the {self.what} '{name}': {self._origins[name]} and {origin}; rename one.")
        self._things[name] = thing
        return thing

    def __getitem__(self, name: str) -> T:
        load_plugins()
        if name not in self._things and name in _modules(self.room, self.hidden):
            importlib.import_module(f"{self.room}.{name}")
        try:
            return self._things[name]
        except KeyError:
            raise RegistryError(f"There is no {self.what} '{name}'{nearest(name, list(self))}.") from None

    def __contains__(self, name: object) -> bool:
        return name in set(self)

    def __iter__(self) -> Iterator[str]:
        load_plugins()
        return iter(dict.fromkeys([*_modules(self.room, self.hidden), *self._things]))

    def __len__(self) -> int:
        return len(list(iter(self)))

    def own(self) -> tuple[str, ...]:
        """Names of the entries of this package, without those of plugins."""
        return _modules(self.room, self.hidden)

    def registering(self, name_of: Callable[[T], str]) -> Callable[[T], T]:
        """Make a decorator that enters what it decorates under the name that ``name_of`` gives."""

        def decorator(thing: T) -> T:
            return self.register(name_of(thing), thing, getattr(thing, "__module__", self.room))

        return decorator


@cache
def _modules(room: str, hidden: tuple[str, ...]) -> tuple[str, ...]:
    package = importlib.import_module(room)
    return tuple(sorted(m.name for m in pkgutil.iter_modules(package.__path__) if m.name not in hidden and not m.name.startswith("_")))


@cache
def load_plugins() -> None:
    """Import the modules that the environment names, once.

    Raises
    ------
    RegistryError
        When one cannot be imported.
    """
    for name in filter(None, (part.strip() for part in os.environ.get(PLUGINS, "").split(","))):
        try:
            importlib.import_module(name)
        except ImportError as error:
            text = f"The plugin {name} of {PLUGINS} cannot be imported ({error}); correct the name or PYTHONPATH."
            raise RegistryError(text) from error
