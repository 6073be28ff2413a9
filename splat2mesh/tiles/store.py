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
from pathlib import Path
from typing import Any

import numpy as np

from ..base.errors import InputError
from ..base.extras import needed
from ..base.inputs import is_url
from ..base.outputs import check_output


class Store:
    """Files under one root, by names with slashes. root: a path, or a URL of fsspec such as s3://bucket/city. Can be
    pickled. Raises InputError where the root cannot be reached or written."""

    def __init__(self, root: str | os.PathLike[str]) -> None:
        self.is_local = not is_url(root)
        self.root = os.path.abspath(root) if self.is_local else os.fspath(root).rstrip("/")

    def path(self, name: str) -> str:
        """The whole name of a file, as its file system takes it; of the root without one."""
        return f"{self.root}/{name}" if name else self.root

    def write(self, name: str, data: bytes) -> str:
        """Write a file; returns its SHA-256. Object stores show an object only once it is whole; a folder gets it by a
        rename."""
        path = self.path(name)
        with _about(f"cannot write {path}"):
            if self.is_local:
                staging = Path(f"{path}.{os.getpid()}.part")
                staging.parent.mkdir(parents=True, exist_ok=True)
                try:
                    staging.write_bytes(data)
                    staging.replace(path)
                finally:
                    staging.unlink(missing_ok=True)
            else:
                self._remote().pipe_file(path, data)
        return hashlib.sha256(data).hexdigest()

    def read(self, name: str, sha256: str | None = None) -> bytes:
        """The bytes of a file. Raises InputError if it is missing, or its checksum is not the given one."""
        path = self.path(name)
        with _about(f"cannot read {path}"):
            data = Path(path).read_bytes() if self.is_local else self._remote().cat_file(path)
        if sha256 is not None and hashlib.sha256(data).hexdigest() != sha256:
            raise InputError(f"{path} has changed while it was worked on")
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

    def remove(self, name: str) -> None:
        """Remove a file or a folder of files, "" for the root, if it exists."""
        where = self.path(name)
        if self.is_local:
            shutil.rmtree(where, ignore_errors=True)
            with suppress(OSError):
                os.unlink(where)
            return
        with _about(f"cannot remove {where}"), suppress(FileNotFoundError):  # another process was faster
            if self._remote().exists(where):
                self._remote().rm(where, recursive=True)

    def begin(self, folder: str, record: str, asked: dict[str, Any], overwrite: bool, resume: bool) -> bool:
        """Empty a folder, "" for the root, for results of `asked`, JSON-clean settings; whether to go on with those
        there instead. record: its file that holds them, alone or by "asked". Raises InputError for a folder that must
        not be written, and for results of other settings."""
        path, there = self.path(folder), self.exists(record)
        if resume and there:
            kept = self.read_json(record)
            if kept.get("asked", kept) != json.loads(json.dumps(asked)):
                raise InputError(f"{path}: was started with other settings or another source: `resume` cannot continue")
        elif there and not overwrite:
            raise InputError(f"{path} exists already: choose another `output`, or `overwrite` or `resume` it")
        elif not folder and self.is_local:
            check_output(path, overwrite or resume, record)
        elif not folder:  # a bucket that cannot be written fails before a large source is read
            self.write("work/begun", b"")
            self.remove("work/begun")
        if there and not resume:
            self.remove(folder)
        return there and resume

    def write_json(self, name: str, value: Any) -> str:
        """A JSON file, the same bytes for the same value; returns its SHA-256."""
        return self.write(name, (json.dumps(value, indent=1) + "\n").encode())

    def read_json(self, name: str, sha256: str | None = None) -> Any:
        """The content of a JSON file, read as `read` does. Raises InputError if it is none."""
        try:
            return json.loads(self.read(name, sha256))
        except ValueError as error:
            if isinstance(error, InputError):
                raise
            raise InputError(f"{self.path(name)}: not valid JSON ({error})") from error

    def write_arrays(self, name: str, /, **arrays: Any) -> str:
        """NumPy arrays as one .npz, not packed; returns its SHA-256."""
        buffer = io.BytesIO()
        np.savez(buffer, **arrays)
        return self.write(name, buffer.getvalue())

    def read_arrays(self, name: str, sha256: str | None = None) -> dict[str, Any]:
        """The arrays of an .npz, read as `read` does."""
        with np.load(io.BytesIO(self.read(name, sha256)), allow_pickle=False) as kept:
            return dict(kept)

    def commit(self, record: str, files: dict[str, bytes], **facts: Any) -> dict[str, Any]:
        """Write files (name -> bytes), then the record that says they are whole; returns the record."""
        sums = {name: {"bytes": len(data), "sha256": self.write(name, data)} for name, data in files.items()}
        value = {**facts, "files": sums}
        self.write_json(record, value)
        return value

    def committed(self, record: str) -> dict[str, Any] | None:
        """A record whose files are all present and whole, or None."""
        with suppress(InputError):
            value: dict[str, Any] = self.read_json(record)
            for name, about in value["files"].items():
                self.read(name, about["sha256"])
            return value
        return None

    def _remote(self) -> Any:
        """The file system of fsspec, which keeps it."""
        fsspec = needed("fsspec", f"{self.root}: a place that is no folder")
        try:
            return fsspec.core.url_to_fs(self.root, use_listings_cache=False)[0]  # others write too
        except (ImportError, ValueError) as error:
            raise InputError(f"{self.root}: {error}") from None


@contextmanager
def _about(what: str) -> Iterator[None]:
    """Within it, every error is an InputError: each kind of store has its own."""
    try:
        yield
    except Exception as error:
        said = getattr(error, "strerror", None) or str(error) or type(error).__name__
        raise InputError(f"{what}: {said.splitlines()[0]}") from error
