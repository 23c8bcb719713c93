"""A bag's own definitions of its message types: what was recorded is decoded by them, not by this machine's."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, TypesysError, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from ..wire.codec import codec
from .rosbags_messages import STORE, decode
from .storage.stored import NO_DEFINITION, Definition, Record

_LARGEST = 10_000  # fields of a type; ROS's own have some hundreds at most
_SEPARATOR = re.compile(r"^={40,}\n", re.MULTILINE)  # between a type and those that it is made of


@lru_cache(maxsize=256)
def store_of(msgtype: str, definition: Definition) -> Typestore | None:
    """The types by which messages of `msgtype` are read.

    ROS 2 Jazzy's own where the bag carries no text, or one of the same layout; None where nobody knows the type.
    """
    known = msgtype in STORE.types
    if not definition.text or (known and _is_jazzy(msgtype, definition)):
        return STORE if known else None
    own = _parsed(msgtype, definition)
    if own is None or (known and own.hash_rihs01(msgtype) == STORE.hash_rihs01(msgtype)):
        return STORE if known else None
    return own


def read_definitions(folder: Path) -> dict[str, Definition]:
    """By type, the definitions in a folder of packages: <package>/msg/<Type>.msg, or without the folder msg.

    Raises:
        ValueError: there is no such file below the folder, or one is no definition.
    """
    found = [file for file in folder.rglob("*.msg") if file.is_file()]
    files = {_type_of(file): file.read_text(encoding="utf-8-sig", errors="replace") for file in found}
    if not files:
        raise ValueError(f"message path {folder} must hold <package>/msg/<Type>.msg files, it has none")
    return {name: Definition(_with_parts(name, files), "ros2msg") for name in files}


def deserialized(record: Record) -> Any:
    """A message as an object of rosbags', with the fields that the bag's definition has.

    Raises:
        ValueError: nobody knows the type, or the bytes are not such a message.
    """
    if record.encoding != "cdr":
        raise ValueError(f"{record.msgtype} must be encoded as cdr, got '{record.encoding}'")
    store = store_of(record.msgtype, record.definition)
    if store is None:
        raise ValueError(f"type {record.msgtype} is not known here, and the bag has no definition that can be read")
    try:
        return store.deserialize_cdr(record.data, record.msgtype)
    except Exception as error:  # rosbags' decoder fails with whatever the bytes lead it into
        words = str(error) or type(error).__name__
        raise ValueError(f"{record.msgtype}: {len(record.data)} bytes cannot be decoded ({words})") from None


def decoded(kind: type, record: Record) -> Any:
    """A core value from a message, by the bag's definition of its type.

    Raises:
        ValueError: the message is of another type, lacks a field, cannot be read, or has an impossible content.
    """
    form = codec(kind)
    if record.msgtype != form.msgtype:
        raise ValueError(f"type must be {form.msgtype}, got {record.msgtype}")
    if record.encoding == "cdr" and store_of(record.msgtype, record.definition) is STORE:
        return decode(kind, record.data, record.t_ns)
    try:
        return form.decode(deserialized(record), record.t_ns)
    except AttributeError as error:
        raise ValueError(f"{record.msgtype} as the bag defines it has no field '{error.name}'") from None


@cache
def jazzy_definition(msgtype: str) -> Definition:
    """ROS 2 Jazzy's own definition of a message type; an empty one where it has none."""
    if msgtype not in STORE.types:
        return NO_DEFINITION
    return Definition(STORE.generate_msgdef(msgtype, ros_version=2)[0], "ros2msg", STORE.hash_rihs01(msgtype))


def _is_jazzy(msgtype: str, definition: Definition) -> bool:
    """By its hash, or to the letter: parsing a text takes tens of milliseconds."""
    return definition.type_hash == STORE.hash_rihs01(msgtype) or definition.text == jazzy_definition(msgtype).text


def _parsed(msgtype: str, definition: Definition) -> Typestore | None:
    """A store of the text's types alone; None for a text that cannot be read."""
    store = get_typestore(Stores.EMPTY)
    try:
        types = _types(msgtype, definition)
        types |= _missing(types)
        if _size(msgtype, types) > _LARGEST:
            return None
        store.register(types)
        store.hash_rihs01(msgtype)  # KeyError where a part is missing
        return store
    except Exception:  # whatever a damaged text leads the parser into; the caller says what could not be decoded
        return None


def _types(msgtype: str, definition: Definition) -> Any:
    if definition.language == "ros2idl":
        found: dict[str, Any] = {}
        for part in filter(str.strip, _SEPARATOR.split(definition.text)):
            found |= get_types_from_idl(re.sub(r"\AIDL: .*\n", "", part))
        return found
    return get_types_from_msg(definition.text, msgtype)


def _type_of(file: Path) -> str:
    package = file.parent.parent if file.parent.name == "msg" else file.parent
    return f"{package.name}/msg/{file.stem}"


def _with_parts(name: str, files: Mapping[str, str]) -> str:
    """A type's text and, each behind a line of equal signs, those of the types that it is made of."""
    texts, waiting = {name: files[name]}, [name]
    while waiting:
        one = waiting.pop()
        try:
            parts_of_one = _parts(get_types_from_msg(texts[one], one)[one])
        except TypesysError:
            raise ValueError(f"{one.replace('/msg/', '/')}.msg of the message path is no message definition") from None
        for part in parts_of_one:
            if part in files and part not in texts:
                texts[part] = files[part]
                waiting.append(part)
    parts = [f"{'=' * 80}\nMSG: {one.replace('/msg/', '/')}\n{text}" for one, text in texts.items() if one != name]
    return "\n".join([files[name], *parts])


def _missing(types: Any) -> Any:
    """What the text refers to and leaves out, as ROS 2 Jazzy has it."""
    found: dict[str, Any] = {}
    names = [name for one in types for name in _parts(types[one])]
    while names:
        name = names.pop()
        if name not in types and name not in found and name in STORE.fielddefs:
            found[name] = STORE.fielddefs[name]
            names += _parts(found[name])
    return found


def _size(msgtype: str, types: Any, sizes: dict[str, int] | None = None) -> int:
    """Fields of a type with all its parts and the elements of its arrays: rosbags writes code for each of them.

    Raises:
        KeyError: a part is not defined.
        RecursionError: a type is a part of itself.
    """
    sizes = {} if sizes is None else sizes
    if msgtype not in sizes:
        sizes[msgtype] = sum(_field_size(kind, types, sizes) for _, kind in types[msgtype][1])
    return sizes[msgtype]


def _field_size(kind: Any, types: Any, sizes: dict[str, int]) -> int:
    if kind[0] == Nodetype.NAME:
        return _size(kind[1], types, sizes)
    if kind[0] in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        element, count = kind[1]
        numbers = element[0] == Nodetype.BASE and element[1][0] != "string"
        repeated = 1 if numbers or kind[0] == Nodetype.SEQUENCE else count
        return repeated * _field_size(element, types, sizes)
    return 1


def _parts(fields: Any) -> list[str]:
    """Names of the message types that a type's fields have."""
    kinds = [kind for _, kind in fields[1]]
    inner = [kind[1][0] if kind[0] in (Nodetype.ARRAY, Nodetype.SEQUENCE) else kind for kind in kinds]
    return [kind[1] for kind in inner if kind[0] == Nodetype.NAME]
