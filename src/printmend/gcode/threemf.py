"""Sliced projects (`.gcode.3mf`): a zip with a G-code member for each plate and its MD5 beside it."""

import hashlib
import re
import zipfile
import zlib
from collections.abc import Callable, Generator, Iterable, Iterator
from typing import IO

from printmend.errors import GcodeError
from printmend.messages import say

_PLATE = re.compile(r"Metadata/plate_\d+\.gcode")
_MAX_BYTES = 8 << 30  # limit of one plate, unpacked
_MAX_OTHER_BYTES = 1 << 30  # limit of any other member, unpacked
_MAX_WHOLE_BYTES = 32 << 30  # limit of all members, unpacked
_MAX_RATIO = 300  # deflate cannot reach 1100; real G-code stays below 20
_RATIO_MATTERS_BYTES = 32 << 20  # smaller members may be packed as tightly as they like
_SLICE_INFO = "Metadata/slice_info.config"  # states the printing time of each plate, in XML
_PLATE_INFO = re.compile(rb"<plate>.*?</plate>", re.DOTALL)
_INDEX = re.compile(rb'key="index"\s+value="(\d+)"')
_TIME = re.compile(rb'(key="(?:prediction|first_layer_time)"\s+value=")([0-9.]+)(?=")')
_SUM = re.compile(rb"[0-9A-Fa-f]{32}")  # an MD5
_COPY_BYTES = 1 << 20  # bytes copied at once
_SETTINGS_BYTES = 4 << 20  # bytes read of a settings file
BROKEN = (zipfile.BadZipFile, zlib.error, EOFError, OSError, ValueError, NotImplementedError)
"""Exceptions that reading a damaged archive can raise."""


def broken(name: str, error: Exception) -> GcodeError:
    """Return the error of a project that is no intact archive."""
    return GcodeError(
        name, wanted=say("intact-gcode-3mf"), came=say("broken-zip", error), todo=say("export-plate-again")
    )


def open_zip(handle: IO[bytes], name: str) -> zipfile.ZipFile:
    """Open the archive after checking for zip bombs, bad paths, encryption and duplicate names."""
    try:
        archive = zipfile.ZipFile(handle)
    except BROKEN as error:
        raise broken(name, error) from None
    seen = set()
    whole = packed = 0
    for member in archive.infolist():
        path, size = member.filename, member.file_size
        limit = _MAX_BYTES if _PLATE.fullmatch(path) else _MAX_OTHER_BYTES
        bomb = size > _RATIO_MATTERS_BYTES and size > _MAX_RATIO * max(member.compress_size, 1)
        whole, packed = whole + size, packed + member.compress_size
        many = whole > _MAX_WHOLE_BYTES or (whole > _RATIO_MATTERS_BYTES and whole > _MAX_RATIO * max(packed, 1))
        bad_path = path.startswith("/") or "\\" in path or ":" in path or ".." in path.split("/")
        for wrong, came in (
            (bad_path, say("the-path", repr(path))),
            (path in seen, say("twice", repr(path))),
            (size > limit or bomb, say("would-unpack-to", repr(path), size)),
            (many, say("members-unpack-to", whole)),
            (member.flag_bits & 1, say("encrypted-member", repr(path))),
        ):
            if wrong:
                raise GcodeError(name, wanted=say("plain-gcode-3mf"), came=came, todo=say("export-plate-again"))
        seen.add(path)
    return archive


def plates(archive: zipfile.ZipFile, name: str) -> tuple[str, ...]:
    """Return the G-code members in the order of their plates."""
    found = [path for path in archive.namelist() if _PLATE.fullmatch(path)]
    if not found:
        came = say("no-plate")
        raise GcodeError(name, wanted=say("sliced-gcode-3mf"), came=came, todo=say("slice-plate-before-exporting"))
    return tuple(sorted(found, key=lambda path: int(re.findall(r"\d+", path)[-1])))


def settings(archive: zipfile.ZipFile) -> bytes:
    """Return the slicer's settings of the whole project (JSON), empty if none can be read."""
    try:
        with archive.open("Metadata/project_settings.config") as member:
            return member.read(_SETTINGS_BYTES)
    except (KeyError, *BROKEN):
        return b""


def plate_pieces(archive: zipfile.ZipFile, path: str, name: str) -> Generator[bytes, None, bool]:
    """Yield a plate's text, and return whether it has the MD5 that stands beside it, if any does."""
    digest = hashlib.md5(usedforsecurity=False)
    for data in _member(archive, archive.getinfo(path), name):
        digest.update(data)
        yield data
    if path + ".md5" not in archive.namelist():
        return True
    said = _SUM.search(b"".join(_member(archive, archive.getinfo(path + ".md5"), name)))
    return said is not None and said[0].lower() == digest.hexdigest().encode()


def write_like(
    source: IO[bytes], name: str, handle: IO[bytes], texts: Callable[[str], Iterable[bytes | memoryview]],
    told: Callable[[str, bytes], bytes],
) -> None:  # fmt: skip
    """Write the project again with ``texts(member)`` as the G-code of each plate, and new MD5s beside them.

    Once all plates are written, ``told(member, line)`` returns a line with a plate's new printing time.
    """
    with open_zip(source, name) as archive, zipfile.ZipFile(handle, "w") as copy:
        sums = {}
        for path in plates(archive, name):
            digest = hashlib.md5(usedforsecurity=False)
            with copy.open(_entry(archive.getinfo(path)), "w", force_zip64=True) as member:
                for text in texts(path):
                    digest.update(text)
                    member.write(text)
            sums[path + ".md5"] = digest.hexdigest()
        copy.comment = archive.comment
        for info in archive.infolist():
            if _PLATE.fullmatch(info.filename):
                continue
            if info.filename in sums:
                old = b"".join(_member(archive, info, name))
                copy.writestr(_entry(info), _same_style(old, sums[info.filename]))
                continue
            if info.filename == _SLICE_INFO and info.file_size <= _SETTINGS_BYTES:
                old = b"".join(_member(archive, info, name))
                copy.writestr(_entry(info), _retold(old, frozenset(plates(archive, name)), told))
                continue
            with copy.open(_entry(info), "w") as member:
                for data in _member(archive, info, name):
                    member.write(data)


def _retold(text: bytes, members: frozenset[str], told: Callable[[str, bytes], bytes]) -> bytes:
    """Return the slicer's description of the plates with their new printing times."""

    def plate(found: re.Match[bytes]) -> bytes:
        index = _INDEX.search(found[0])
        member = f"Metadata/plate_{int(index[1])}.gcode" if index else ""
        if member not in members:
            return found[0]
        return _TIME.sub(lambda time: time[1] + told(member, b"time=" + time[2]).partition(b"=")[2], found[0])

    return _PLATE_INFO.sub(plate, text)


def _member(archive: zipfile.ZipFile, info: zipfile.ZipInfo, name: str) -> Iterator[bytes]:
    try:
        with archive.open(info) as member:
            while data := member.read(_COPY_BYTES):
                yield data
    except BROKEN as error:
        raise broken(name, error) from None


def _entry(info: zipfile.ZipInfo) -> zipfile.ZipInfo:
    """Return a new entry with the old one's name, date, compression and attributes."""
    entry = zipfile.ZipInfo(info.filename, info.date_time)
    entry.compress_type, entry.external_attr = info.compress_type, info.external_attr
    entry.create_system, entry.comment, entry.file_size = info.create_system, info.comment, info.file_size
    return entry


def _same_style(old: bytes, digest: str) -> bytes:
    """Replace the old digest with the new one, in the same upper or lower case."""
    found = _SUM.search(old)
    if not found:
        return digest.upper().encode()
    new = digest.encode() if found[0] == found[0].lower() else digest.upper().encode()
    return old[: found.start()] + new + old[found.end() :]
