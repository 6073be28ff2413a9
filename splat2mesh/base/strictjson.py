"""JSON that every reader accepts: the standard has no Infinity and no NaN, but Python writes them."""

import json
import math
from typing import Any


def text_of(content: Any, **how: Any) -> str:
    """The result of json.dumps, with null for numbers that are not finite; `how` is passed to it."""
    return json.dumps(_finite(content), allow_nan=False, **how)


def _finite(content: Any) -> Any:
    if isinstance(content, float):
        return content if math.isfinite(content) else None
    if isinstance(content, dict):
        return {key: _finite(value) for key, value in content.items()}
    if isinstance(content, (list, tuple)):
        return [_finite(value) for value in content]
    return content
