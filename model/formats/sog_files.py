"""The files of a SOG scene, meta.json and its images: in a zip archive, or in a folder."""

import io
import os
import zipfile
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from splatcore.model.formats import file
from splatcore.model.formats.file import input_error

META = "meta.json"


def beside(path: str | os.PathLike, name: str) -> Path:
    """The path of a file that a JSON file at `path` names, relative to its own folder.

    Raises InputError for a name that leaves the folder, and for a file that does not exist.
    """
    relative = PurePosixPath(name)
    if relative.is_absolute() or ".." in relative.parts:
        raise input_error(path, f"{name[:80]!r} is not in its folder")
    found = Path(path).parent / relative
    if not os.path.exists(found):
        raise input_error(path, f"no {name[:80]} in its folder")
    return found


@dataclass(frozen=True)
class Zipped:
    """Files in a zip archive. size: bytes of the archive"""

    path: str | os.PathLike
    size: int
    archive: zipfile.ZipFile

    def where(self, name: str) -> str:
        """The location of a file for messages."""
        return f"{self.path}: {name}"

    def read(self, name: str) -> bytes:
        """Read a file of the archive, checking its declared size before unpacking."""
        if name not in self.archive.namelist():
            raise input_error(self.path, f"no {name}")
        where = self.where(name)
        info = self.archive.getinfo(name)
        if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise input_error(where, f"zip compression {info.compress_type} is not supported")
        file.check_expansion(info.file_size, self.size, where)
        with file.reading(where):
            return self.archive.read(info)


@dataclass(frozen=True)
class Unbundled:
    """Files in the folder of a meta.json. path: the meta.json; size: bytes of it and its images"""

    path: str | os.PathLike
    size: int

    def where(self, name: str) -> str:
        """The location of a file for messages."""
        return str(self.path if name == META else beside(self.path, name))

    def read(self, name: str) -> bytes:
        """Read a file of the folder."""
        return file.read_bytes(beside(self.path, name))


def open_files(path: str | os.PathLike) -> tuple[Zipped | Unbundled, dict]:
    """Open a SOG file or a meta.json; also returns the content of meta.json."""
    data = file.read_bytes(path)
    if data.lstrip()[:1] == b"{":
        meta = file.checked(file.parse_json(data, path), dict, path)
        return Unbundled(path, len(data) + _size(path, meta)), meta
    with file.reading(path, "is not a zip archive"):
        files = Zipped(path, len(data), zipfile.ZipFile(io.BytesIO(data)))
    where = files.where(META)
    return files, file.checked(file.parse_json(files.read(META), where), dict, where)


def _size(path: str | os.PathLike, meta: dict) -> int:
    """Bytes of all images that a meta.json names."""
    lists = (section.get("files") for section in meta.values() if isinstance(section, dict))
    names = (name for each in lists if isinstance(each, list) for name in each)
    paths = {beside(path, name) for name in names if isinstance(name, str)}
    return sum(map(file.file_size, paths))
