"""Types of kernels' arguments as text, to ship with the package: Numba's own pickles belong to one version of it."""

import importlib
from typing import Any

import numpy as np
from numba import types
from numba.np.numpy_support import from_dtype

Text = str | list[Any]
"""A type as JSON holds it: a word of Numba such as "float32", or a list whose first entry names what it is made of."""


def text_of(kind: types.Type) -> Text:
    """A type as text. Raises ValueError for one that no text stands for, such as that of a function."""
    text: Text
    if isinstance(kind, types.Array):
        text = ["array", text_of(kind.dtype), kind.ndim, kind.layout, "" if kind.mutable else "readonly"]
    elif isinstance(kind, types.BaseNamedTuple):
        cls = kind.instance_class
        text = ["named", cls.__module__, cls.__qualname__, *map(text_of, kind.types)]
    elif isinstance(kind, (types.UniTuple, types.Tuple)):
        text = ["tuple", *map(text_of, kind.types)]
    elif isinstance(kind, types.Record):
        parts = kind.dtype
        fields = [[name, parts.fields[name][0].str, parts.fields[name][1]] for name in parts.names]
        text = ["record", parts.itemsize, kind.aligned, *fields]
    else:
        text = str(kind)
    if type_of(text) != kind:
        raise ValueError(f"no text for the type {kind}")
    return text


def type_of(text: Text) -> types.Type:
    """The type that a text stands for. Raises ValueError for another text, ImportError and AttributeError for a tuple
    of an unknown class."""
    if isinstance(text, str):
        found = getattr(types, "boolean" if text == "bool" else text, None)
        if not isinstance(found, types.Type):
            raise ValueError(f"no type {text!r}")
        return found
    name, *rest = text
    if name == "array":
        element, dimensions, layout, readonly = rest
        return types.Array(type_of(element), dimensions, layout, readonly=bool(readonly))
    if name == "named":
        module, qualname, *members = rest
        return types.BaseTuple.from_types(
            tuple(map(type_of, members)), getattr(importlib.import_module(module), qualname)
        )
    if name == "tuple":
        return types.BaseTuple.from_types(tuple(map(type_of, rest)))
    if name == "record":
        size, aligned, *fields = rest
        names, formats, offsets = zip(*fields, strict=True)
        parts: Any = {"names": names, "formats": formats, "offsets": offsets, "itemsize": size}
        return from_dtype(np.dtype(parts, align=aligned))
    raise ValueError(f"no type {name!r}")
