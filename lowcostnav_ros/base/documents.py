"""Files: text, tables and YAML read in one place, what cannot be read refused in one sentence; written whole or not at all."""

import csv
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from lowcostnav_ros.base.settings import SettingsError, shown

LARGEST_BYTES = 4_000_000
"""No file of settings is larger; a recording given by mistake would be parsed for minutes."""
_DEEPEST, _MOST = 30, 300_000


def read_text(path: str | Path) -> str:
    """Return the text of a UTF-8 file, without the mark some editors begin it with.

    Raises
    ------
    SettingsError
        For a file that is missing, unreadable, too large or not UTF-8; the sentence names it.
    """
    path = Path(path)
    try:
        if path.stat().st_size > LARGEST_BYTES:
            raise SettingsError(f"{path} holds more than {LARGEST_BYTES / 1e6:.0f} MB, too much for settings; check the path of the file.")
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise SettingsError(f"{path} does not exist; check the path of the file.") from None
    except OSError as error:
        raise SettingsError(f"{path} cannot be read: {error.strerror or error}.") from error
    except UnicodeDecodeError as error:
        line = bytes(error.object[: error.start]).count(b"\n") + 1
        raise SettingsError(f"{path} is not UTF-8 text at line {line}; save it with that encoding.") from error


def foreign_text(raw: bytes) -> str:
    """Return the text of another program's file: UTF-8 or UTF-16 as its mark says, UTF-8, or else Latin-1 as Windows writes it."""
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return raw.decode("utf-16", errors="replace")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def read_yaml(path: str | Path) -> Any:
    """Return the content of a YAML file; see :func:`read_text` and :func:`parse_yaml` for what is refused."""
    return parse_yaml(read_text(path), str(path))


def parse_yaml(text: str, where: str) -> Any:
    """Return the content of YAML text: mappings of names, lists and plain values, no deeper than a person writes.

    Parameters
    ----------
    text : str
    where : str
        What to call the source in a refusal, usually the path.

    Raises
    ------
    SettingsError
        For text that is not YAML, names that are no text, and values that hold themselves or are nested or repeated without end.
    """
    try:
        content = yaml.safe_load(text)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        at = f" at line {mark.line + 1}" if mark else ""
        raise SettingsError(f"{where} is not valid YAML{at}: {shown(getattr(error, 'problem', None) or error, str)}.") from error
    except RecursionError:
        raise SettingsError(f"{where} is nested too deeply; write it flatter.") from None
    except (ValueError, TypeError, AttributeError, OverflowError, LookupError) as error:  # a date or number that is none
        raise SettingsError(f"{where} holds a value that cannot be read ({shown(error, str)}); correct it.") from error
    _refuse_strange(content, where)
    return content


def _refuse_strange(content: Any, where: str) -> None:
    level, seen = [content], 0
    for _ in range(_DEEPEST):
        seen += len(level)
        if seen > _MOST:
            raise SettingsError(f"{where} repeats its values without end; write them out without aliases.")
        level = [item for value in level for item in _items(value, where)]
        if not level:
            return
    raise SettingsError(f"{where} is nested too deeply, or holds itself; write it flatter.")


def _items(value: Any, where: str) -> Iterable[Any]:
    if isinstance(value, dict):
        for key in value:
            if not isinstance(key, str):
                raise SettingsError(f"{where}: the name {shown(key)} is no text; put it into quotes.")
        return value.values()
    return value if isinstance(value, list) else ()


def delimiter_of(line: str) -> str:
    """Return what separates the cells of a line: a tab, a semicolon, a comma, or else ``whitespace``."""
    return next((mark for mark in "\t;," if mark in line), "whitespace")


def number_in(cell: str) -> float:
    """The number that a cell of a table holds; NaN where it is none."""
    try:
        return float(cell)
    except ValueError:
        return float("nan")


def cells_of(line: str, delimiter: str) -> list[str]:
    """Return the cells of a line of a table, without blanks around them and the quotes that some programs write."""
    if delimiter == "whitespace":
        return line.split()
    if '"' in line and len(delimiter) == 1:
        try:
            return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))]
        except (csv.Error, StopIteration):
            pass
    return [cell.strip() for cell in line.split(delimiter)]


def write_text(path: str | Path, text: str) -> None:
    """Write a text file whole; raises as :func:`written_whole` does."""
    with written_whole(path) as place:
        place.write_text(text, encoding="utf-8")


@contextmanager
def written_whole(path: str | Path) -> Iterator[Path]:
    """Give a place to write a file or folder to, which takes the name ``path`` at the end; after a failure nothing is left.

    Raises
    ------
    SettingsError
        At once, where nothing can be written there.
    """
    path = Path(path)
    try:
        folder = Path(tempfile.mkdtemp(prefix=f".{path.name}.", suffix=".partial", dir=path.parent))
    except OSError as error:
        raise SettingsError(f"Cannot write {path}: {error.strerror}; check the path and its permissions.") from error
    try:
        yield folder / path.name
        try:
            os.replace(folder / path.name, path)
        except OSError as error:
            raise SettingsError(f"Cannot write {path}: {error.strerror}.") from error
    finally:
        shutil.rmtree(folder, ignore_errors=True)
