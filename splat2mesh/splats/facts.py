"""What a splat file says beside its Gaussians: how they are to be drawn, which way is up, where they lie."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Vector3 = tuple[float, float, float]

HERE: Vector3 = (0.0, 0.0, 0.0)

_NUMBER = re.compile(r"[-+]?[\d.]+(?:e[-+]?\d+)?", re.IGNORECASE)
_AXES: dict[str, Vector3] = {"x": (1.0, 0.0, 0.0), "z": (0.0, 0.0, 1.0), "-z": (0.0, 0.0, -1.0)}


@dataclass(frozen=True)
class FileFacts:
    """Facts of a splat file, None or the default where it says nothing.

    antialiased: whether the splats were trained for a rasteriser that makes up for its blur, that of Mip-Splatting. up:
    (x, y, z) or None, the direction that points up, in the frame of the Splats. up_from: what says so. frame: the axes
    that the file states, where its format leaves them open. metres: of one unit. offset: (x, y, z), Float64 numbers,
    added to the means: the coordinates in the file, where these are too large for float32.
    """

    antialiased: bool | None = None
    up: Vector3 | None = None
    up_from: str = ""
    frame: str = ""
    metres: float | None = None
    offset: Vector3 = HERE

    def turned(self, linear: NDArray[np.float64]) -> "FileFacts":
        """Return the facts in another frame. linear: (3, 3), new_from_old, a rotation times a scale."""
        up = self.up
        if up is not None:
            turned = linear @ np.asarray(up)
            up = _vector(turned / max(float(np.linalg.norm(turned)), 1e-300))
        scale = float(np.cbrt(np.abs(np.linalg.det(linear))))
        metres = None if self.metres is None else self.metres / max(scale, 1e-300)
        return replace(self, up=up, metres=metres, offset=_vector(linear @ np.asarray(self.offset)))


NO_FACTS = FileFacts()
"""Of a file that says nothing."""


def facts_of_comments(comments: Iterable[str]) -> FileFacts:
    """Read the comments of a PLY header that trainers write.

    Returns FileFacts: `Vertical Axis` of nerfstudio and Brush: a letter, or the up vector. `y` is what Brush writes
    where it knows nothing, so it says nothing. `SplatRenderMode` of Brush and `antialiased` of Postshot.
    """
    facts = NO_FACTS
    for comment in comments:
        words = " ".join(comment.lower().split())
        key, _, value = words.partition(": ")
        if key == "vertical axis":
            numbers = [float(number) for number in _NUMBER.findall(value) if number.strip("+-.")]
            up = _AXES.get(value.removeprefix("+"), tuple(numbers) if len(numbers) == 3 else None)
            if up is not None and 0.0 < float(np.linalg.norm(up)) < np.inf:
                length = float(np.linalg.norm(up))
                facts = replace(facts, up=_vector([part / length for part in up]), up_from=f"'{comment.strip()}'")
        elif key == "splatrendermode" and value in ("mip", "default"):
            facts = replace(facts, antialiased=value == "mip")
        elif words in ("antialiased 0", "antialiased 1"):
            facts = replace(facts, antialiased=words.endswith("1"))
    return facts


def comments_of(facts: FileFacts) -> list[str]:
    """Return the comments of a PLY header by which `facts_of_comments` finds the same."""
    found = []
    if facts.up is not None:
        found.append("Vertical axis: " + " ".join(f"{part:.9g}" for part in facts.up))
    if facts.antialiased is not None:
        found.append(f"SplatRenderMode: {'mip' if facts.antialiased else 'default'}")
    return found


def common(facts: Sequence[FileFacts]) -> FileFacts:
    """Return what several files say together: a fact on which two differ is none. facts: at least one. Returns
    FileFacts at the offset of the first that has one."""
    first = facts[0]
    one: dict[str, Any] = {name: getattr(first, name) for name in ("antialiased", "frame", "metres")}
    one = {name: value for name, value in one.items() if all(getattr(each, name) == value for each in facts)}
    if first.up is not None and all(each.up == first.up for each in facts):
        one |= {"up": first.up, "up_from": first.up_from}
    return FileFacts(**one, offset=next((each.offset for each in facts if each.offset != HERE), HERE))


def _vector(values: Iterable[float]) -> Vector3:
    x, y, z = (float(value) + 0.0 for value in values)
    return x, y, z
