"""Registries: a thing is described once, where it is defined, and found by its name.

A registry looks in a room: every module of the room is one entry and registers itself when it is imported, which happens only when that
entry is asked for.  What stands outside this package is named by the environment variable ``LOWCOSTNAV_PLUGINS``, modules separated by
commas: they are imported before the first look-up and register what they define in the same way.
"""

import ast
import contextlib
import importlib
import os
import pkgutil
import traceback
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any, Generic, TypeVar

from lowcostnav_ros.base.settings import SettingsError, nearest

T = TypeVar("T")

PLUGINS = "LOWCOSTNAV_PLUGINS"
"""Environment variable that names modules to import, separated by commas."""


class RegistryError(SettingsError):
    """A name that is not registered, or registered twice; the message is one sentence that lists what exists."""


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
    many : bool
        A module may register several entries under names of their own: all modules are imported at the first look-up.
    """

    def __init__(self, what: str, room: str, hidden: tuple[str, ...] = (), *, many: bool = False) -> None:
        self.what, self.room, self.hidden, self.many = what, room, hidden, many
        self._things: dict[str, T] = {}
        self._origins: dict[str, str] = {}
        self._complete = False

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

    def forget(self, origin: str) -> None:
        """Take out what a module has entered, as if it had never been imported."""
        for name in [name for name, where in self._origins.items() if where == origin]:
            del self._things[name], self._origins[name]

    def __getitem__(self, name: str) -> T:
        names = self._load()
        if name not in self._things and name in names:
            importlib.import_module(names[name])
        try:
            return self._things[name]
        except KeyError:
            raise RegistryError(f"There is no {self.what} '{name}'{nearest(name, list(self))}.") from None

    def __contains__(self, name: object) -> bool:
        names = self._load()
        return name in self._things or name in names

    def __iter__(self) -> Iterator[str]:
        names = self._load()
        return iter(sorted(self._things) if self.many else dict.fromkeys([*names, *self._things]))

    def __len__(self) -> int:
        return len(list(iter(self)))

    def own(self) -> tuple[str, ...]:
        """Names of the entries of this package, without those of plugins."""
        names = self._load()
        return tuple(name for name in self if self._origins[name].startswith(f"{self.room}.")) if self.many else tuple(names)

    def _load(self) -> dict[str, str]:
        """Import the plugins, and once the modules of a room of many; return the entries that a look-up may still import."""
        load_plugins()
        if not self.many:
            return self._places()
        if not self._complete:  # messages are looked up by the thousand
            for module in self._places().values():
                importlib.import_module(module)
            self._complete = True
        return {}

    def _places(self) -> dict[str, str]:
        """Name of each entry of the room, and the module that holds it."""
        return {name: f"{self.room}.{name}" for name in _modules(self.room, self.hidden)}


class ClassRegistry(Registry[Any]):
    """Classes that carry one decorator, in any file of a room; what a class writes out about itself is read without importing it.

    Parameters
    ----------
    what, room : str
        As of :class:`Registry`.
    decorator : str
        Name under which modules use :meth:`entry`.
    label : type
        Dataclass of what may be asked without the import: ``name`` and more, with defaults.  Each stands as a literal among the arguments
        of the decorator or in the body of the class itself.
    """

    def __init__(self, what: str, room: str, decorator: str, label: type) -> None:
        super().__init__(what, room)
        self._decorator, self._label = decorator, label

    def entry(self, name: str = "", **attributes: Any) -> Callable[[type], type]:
        """Make a decorator that gives a class these attributes and its ``name``, if it has none, and enters it.

        Raises
        ------
        RegistryError
            (from the decorator) when another module has entered one of this name, or the room holds one.
        """

        def decorate(cls: Any) -> Any:
            for attribute, value in (attributes | ({"name": name} if name else {})).items():
                setattr(cls, attribute, value)
            self._origins.setdefault(cls.name, self._places().get(cls.name, cls.__module__))
            return self.register(cls.name, cls, cls.__module__)

        return decorate

    def label(self, name: str) -> Any:
        """Return what a class writes out about itself."""
        own = _described(self.room, self._decorator)
        written = own[name][1] if name in own else vars(self[name])
        return self._label(**{f.name: written[f.name] for f in fields(self._label) if f.name in written})

    def _places(self) -> dict[str, str]:
        return {name: module for name, (module, _) in _described(self.room, self._decorator).items()}


@cache
def _described(room: str, decorator: str) -> dict[str, tuple[str, dict[str, Any]]]:
    """Decorated classes of a room by name: their module, and what they write out."""
    found = {}
    for folder in map(Path, importlib.import_module(room).__path__):
        for file in folder.rglob("*.py"):
            text = file.read_text(encoding="utf-8")
            for node in ast.parse(text).body if f"\n@{decorator}" in text else ():
                written = _written(node, decorator)
                if "name" in written:
                    found[written["name"]] = ".".join((room, *file.relative_to(folder).with_suffix("").parts)), written
    return dict(sorted(found.items()))


def _written(node: ast.stmt, decorator: str) -> dict[str, Any]:
    """Literals of a class and of its decorator, the decorator's first argument as ``name``; empty where it has no such decorator."""
    pairs: list[tuple[str, ast.expr]] = []
    for mark in getattr(node, "decorator_list", ()):
        call = mark if isinstance(mark, ast.Call) else ast.Call(mark, [], [])
        if isinstance(node, ast.ClassDef) and getattr(call.func, "id", "") == decorator:
            pairs = [(target.id, value) for line in node.body for target, value in _assigned(line) if isinstance(target, ast.Name)]
            pairs += [*(("name", argument) for argument in call.args[:1]), *((word.arg or "", word.value) for word in call.keywords)]
    written = {}
    for attribute, value in pairs:
        with contextlib.suppress(ValueError, TypeError):  # no literal
            written[attribute] = ast.literal_eval(value)
    return written


def _assigned(line: ast.stmt) -> list[tuple[ast.expr, ast.expr]]:
    if isinstance(line, ast.AnnAssign):
        return [(line.target, line.value)] if line.value else []
    return [(target, line.value) for target in line.targets] if isinstance(line, ast.Assign) else []


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
        When one cannot be imported, or fails while it is.
    """
    for name in filter(None, (part.strip() for part in os.environ.get(PLUGINS, "").split(","))):
        try:
            importlib.import_module(name)
        except RegistryError:
            raise
        except ImportError as error:
            sentence = f"The plugin '{name}' of {PLUGINS} cannot be imported ({error}); correct the name or PYTHONPATH."
            raise RegistryError(sentence) from error
        except Exception as error:  # whatever a plugin's code may raise
            last = traceback.extract_tb(error.__traceback__)[-1]
            where = "" if isinstance(error, SyntaxError) else f", {Path(last.filename).name} line {last.lineno}"
            sentence = f"The plugin '{name}' of {PLUGINS} fails when it is imported ({type(error).__name__}: {error}{where}); correct it."
            raise RegistryError(sentence) from error
