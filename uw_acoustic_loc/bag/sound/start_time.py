"""When a recording began: by the file's name, or else by what the recorder wrote into it."""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

from .files import stream_at

_NAMES = (
    re.compile(r"(?<!\d)(?P<Y>\d{4})-?(?P<m>\d\d)-?(?P<d>\d\d)[T_-]?(?P<H>\d\d)[:-]?(?P<M>\d\d)[:-]?(?P<S>\d\d)"
               r"(?:[._](?P<f>\d{3,6}))?(?P<z>Z|[+-]\d\d:?\d\d)?(?!\d)"),  # AudioMoth, AMAR, PAMGuard
    re.compile(r"\.(?P<y>\d\d)(?P<m>\d\d)(?P<d>\d\d)(?P<H>\d\d)(?P<M>\d\d)(?P<S>\d\d)(?!\d)"),  # SoundTrap
)  # fmt: skip
_AUDIOMOTH = re.compile(rb"Recorded at (\d\d:\d\d:\d\d \d\d/\d\d/\d{4}) \(UTC([+-]\d{1,2})?(?::?(\d\d))?\)")
_GUANO = re.compile(rb"^Timestamp:\s*(\S+)", re.MULTILINE)
_BEXT = re.compile(r"(\d{4})[-:_ ./](\d\d)[-:_ ./](\d\d)(\d\d)[-:_ ./](\d\d)[-:_ ./](\d\d)")
_HEAD = 1 << 16  # bytes in which recorders write about themselves
_SECOND = 1_000_000_000


def start_of(path: Path, time_format: str = "") -> int | None:
    """ns since 1970 of a file's first sample; None where neither its name nor its content says.

    Times are UTC unless they have a zone. `time_format` is one of strptime's for the whole name without suffix.

    Raises:
        ValueError: the name does not fit `time_format`, or that is none.
    """
    if time_format:
        try:
            return _ns(_utc(datetime.strptime(path.stem, time_format)))
        except ValueError as error:
            raise ValueError(f"the name of {path} must fit --time-format: {error}") from None
    return _by_name(path.name) or _by_content(path)


def _by_name(name: str) -> int | None:
    for pattern in _NAMES:
        for match in pattern.finditer(name):
            part = match.groupdict()
            year = part.get("Y") or f"20{part['y']}"
            digits = year + "".join(part[key] for key in "mdHMS")
            try:
                found = datetime.strptime(digits, "%Y%m%d%H%M%S").replace(tzinfo=_zone(part.get("z") or ""))
            except ValueError:
                continue  # digits that are no date
            fraction = part.get("f") or ""
            return _ns(found) + (int(fraction.ljust(9, "0")) if fraction else 0)
    return None


def _by_content(path: Path) -> int | None:
    with path.open("rb") as stream:
        size = stream.seek(0, 2)
        text = stream_at(stream, 0, _HEAD) + stream_at(stream, max(size - _HEAD, _HEAD), _HEAD)
    try:
        return _guano(text) or _audiomoth(text) or _bext(text)
    except ValueError:
        return None  # a date that is none


def _guano(text: bytes) -> int | None:
    match = _GUANO.search(text) if b"GUANO|Version" in text else None
    return _ns(_utc(datetime.fromisoformat(match[1].decode(errors="replace")))) if match else None


def _audiomoth(text: bytes) -> int | None:
    match = _AUDIOMOTH.search(text)
    if not match:
        return None
    hours, minutes = int(match[2] or 0), int(match[3] or 0)
    zone = timezone(timedelta(hours=hours, minutes=minutes if hours >= 0 else -minutes))
    return _ns(datetime.strptime(match[1].decode(), "%H:%M:%S %d/%m/%Y").replace(tzinfo=zone))


def _bext(text: bytes) -> int | None:
    """Origination date and time of a broadcast extension: behind 256 + 32 + 32 bytes of texts."""
    at = text.find(b"bext")
    match = _BEXT.match(text[at + 8 + 320 : at + 8 + 338].decode(errors="replace")) if at >= 0 else None
    return _ns(_utc(datetime.strptime("".join(match.groups()), "%Y%m%d%H%M%S"))) if match else None


def _zone(text: str) -> timezone:
    if text in ("", "Z"):
        return UTC
    sign, digits = -1 if text[0] == "-" else 1, text[1:].replace(":", "")
    return timezone(sign * timedelta(hours=int(digits[:2]), minutes=int(digits[2:])))


def _utc(found: datetime) -> datetime:
    return found if found.tzinfo else found.replace(tzinfo=UTC)


def _ns(found: datetime) -> int:
    since = found - datetime(1970, 1, 1, tzinfo=UTC)
    return (since.days * 86400 + since.seconds) * _SECOND + since.microseconds * 1000
