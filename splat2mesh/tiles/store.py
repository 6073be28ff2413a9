"""The storage of a city's files: a local folder, or any that fsspec reaches. A file appears whole or not at all.

A result of several files is done once its record, a JSON file that holds their checksums, is there.
"""

import hashlib
import io
import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np

from ..base.errors import InputError
from ..base.extras import needed


class Store:
    """Files under one root, by names with slashes. root: a path, or a URL of fsspec such as s3://bucket/city. Can be
    pickled: a worker opens it again. Raises InputError where the root cannot be reached or written."""

    def __init__(self, root: str | os.PathLike[str]) -> None:
        self.root = os.fspath(root)
        self._fs: Any = None
        if "://" in self.root:
            self.root = self.root.rstrip("/")
        else:
            self.root = os.path.abspath(self.root)

    def __getstate__(self) -> dict[str, Any]:
        return {"root": self.root, "_fs": None}

    @property
    def is_local(self) -> bool:
        """Whether it is a local folder."""
        return "://" not in self.root

    def path(self, name: str) -> str:
        """The whole name of a file, as its file system takes it."""
        return f"{self.root}/{name}" if name else self.root

    def write(self, name: str, data: bytes) -> None:
        """Write a file. Object stores show an object only once it is whole; a folder gets it by a rename."""
        path = self.path(name)
        with _about(f"cannot write {path}"):
            if not self.is_local:
                self._remote().pipe_file(path, data)
                return
            os.makedirs(os.path.dirname(path), exist_ok=True)
            staging = f"{path}.{os.getpid()}.part"
            try:
                with open(staging, "wb") as file:
                    file.write(data)
                os.replace(staging, path)
            finally:
                if os.path.lexists(staging):
                    os.unlink(staging)

    def read(self, name: str) -> bytes:
        """The bytes of a file. Raises InputError if it is missing."""
        path = self.path(name)
        with _about(f"cannot read {path}"):
            if not self.is_local:
                return self._remote().cat_file(path)
            with open(path, "rb") as file:
                return file.read()

    def read_unchanged(self, name: str, sha256: str) -> bytes:
        """The bytes of a file that all tasks share. Raises InputError if its checksum differs."""
        data = self.read(name)
        if hashlib.sha256(data).hexdigest() != sha256:
            raise InputError(f"{self.path(name)} has changed while it was worked on")
        return data

    def exists(self, name: str) -> bool:
        """Whether there is such a file."""
        if self.is_local:
            return os.path.isfile(self.path(name))
        with _about(f"cannot read {self.path(name)}"):
            try:
                return bool(self._remote().info(self.path(name))["type"] == "file")
            except FileNotFoundError:
                return False

    def listed(self) -> dict[str, int]:
        """All files of a store of fsspec below the root, or the file that the root itself is, by "": bytes of each."""
        with _about(f"cannot read {self.root}"):
            fs = self._remote()
            top = fs._strip_protocol(self.root)
            try:
                found = fs.find(top, detail=True)
            except FileNotFoundError:
                return {}
        return {name.removeprefix(top).lstrip("/"): int(about["size"]) for name, about in sorted(found.items())}

    def remove(self, folder: str) -> None:
        """Remove a folder of files, if it exists."""
        where = self.root if folder == "." else self.path(folder)
        if self.is_local:
            shutil.rmtree(where, ignore_errors=True)
        else:
            self._gone(where, recursive=True)

    def remove_file(self, name: str) -> None:
        """Remove a file, if it exists."""
        if self.is_local:
            if os.path.lexists(self.path(name)):
                os.unlink(self.path(name))
        else:
            self._gone(self.path(name), recursive=False)

    def _gone(self, where: str, recursive: bool) -> None:
        with _about(f"cannot remove {where}"), suppress(FileNotFoundError):  # another process was faster
            if self._remote().exists(where):
                self._remote().rm(where, recursive=recursive)

    def write_json(self, name: str, value: Any) -> None:
        """A JSON file, the same bytes for the same value."""
        self.write(name, (json.dumps(value, indent=1) + "\n").encode())

    def read_json(self, name: str) -> Any:
        """The content of a JSON file. Raises InputError if it is none."""
        try:
            return json.loads(self.read(name))
        except ValueError as error:
            raise InputError(f"{self.path(name)}: not valid JSON ({error})") from error

    def write_arrays(self, name: str, **arrays: Any) -> None:
        """NumPy arrays as one .npz, not packed."""
        self.write(name, bytes_of_arrays(**arrays))

    def read_arrays(self, name: str) -> dict[str, Any]:
        """The arrays of an .npz."""
        return arrays_of(self.read(name))

    def commit(self, record: str, files: dict[str, bytes], **facts: Any) -> dict[str, Any]:
        """Write files (name -> bytes), then the record that says they are whole; returns the record."""
        for name, data in files.items():
            self.write(name, data)
        sums = {name: {"bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()} for name, data in files.items()}
        value = {**facts, "files": sums}
        self.write_json(record, value)
        return value

    def committed(self, record: str) -> dict[str, Any] | None:
        """A record whose files are all present and whole, or None."""
        if not self.exists(record):
            return None
        value = self.read_json(record)
        for name, about in value["files"].items():
            if not self.exists(name) or hashlib.sha256(self.read(name)).hexdigest() != about["sha256"]:
                return None
        return value

    def _remote(self) -> Any:
        if self._fs is None:
            fsspec = needed("fsspec", f"{self.root}: a place that is no folder")
            try:
                self._fs = fsspec.core.url_to_fs(self.root, use_listings_cache=False)[0]  # others write too
            except (ImportError, ValueError) as error:
                raise InputError(f"{self.root}: {error}") from None
        return self._fs


def bytes_of_arrays(**arrays: Any) -> bytes:
    """NumPy arrays as one .npz, not packed."""
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


def arrays_of(data: bytes) -> dict[str, Any]:
    """The arrays of an .npz."""
    with np.load(io.BytesIO(data), allow_pickle=False) as kept:
        return dict(kept)


@contextmanager
def _about(what: str) -> Iterator[None]:
    """Within it, every error is an InputError: each kind of store has its own."""
    try:
        yield
    except Exception as error:
        said = getattr(error, "strerror", None) or str(error) or type(error).__name__
        raise InputError(f"{what}: {said.splitlines()[0]}") from error
