"""The effects of light transport that a scene can be lit with: which a choice names, and which a scene calls for."""

from splat2mesh.base.errors import InputError

from ..transfer import SHADOWING
from ..transfer.settings import BOUNCES, EFFECTS, SHADOWS, SUN

__all__ = ["BOUNCES", "EFFECTS", "SHADOWS", "SUN", "chosen_effects", "plan"]


def plan(scene, environment, tolerance=None, albedo_linear=None, **wishes):
    """What a Scene under an Environment, at any rotation of it, calls for: a `planning.plan.Plan`.

    On a sample of the vertices it measures what each effect gives, and picks the cheapest settings whose predicted
    error (relative L2 of exit radiance) is within the tolerance. albedo_linear: (V, 3), white without. wishes: keyword
    arguments of `planning.decide.planned`, such as budget_s. Raises InputError for a scene that cannot be lit.
    """
    from ..transfer.occluder import Occluder
    from .decide import planned
    from .plan import DEFAULT_TOLERANCE

    sizes = [len(chunk.vertices) for chunk in scene.chunks]
    occluder = Occluder(scene.vertices, scene.normals, scene.faces)
    return planned(occluder, sizes, environment, albedo_linear, tolerance or DEFAULT_TOLERANCE, **wishes)


def chosen_effects(choice, method):
    """(effects, auto): the set of effects of "auto", "none" or a list of names, and whether it was "auto".

    "auto" stays with all that `method` can do, "none" and an empty list with nothing. A list is text with spaces or
    commas, or names. Sun and bounces are traced among shadows, and all three need rays. Raises InputError for
    anything else.
    """
    names = choice.replace(",", " ").split() or [""] if isinstance(choice, str) else list(map(str, choice))
    able = frozenset(EFFECTS if method in ("auto", *SHADOWING) else ())
    if names == ["auto"]:
        return able, True
    effects = frozenset(() if names == ["none"] else names)
    listed = " ".join(sorted(effects))
    if effects - set(EFFECTS):
        raise InputError(f"effects {listed!r}: expected auto or none alone, or some of {' '.join(EFFECTS)}")
    if effects - {SHADOWS} and SHADOWS not in effects:
        raise InputError(f"effects {listed}: sun and bounces need shadows too")
    if effects - able:
        raise InputError(f"effects {listed}: the method {method} has none; leave it at auto")
    if method in SHADOWING and not effects:
        raise InputError(f"effects none: the method {method} has shadows at least; use analytic, or leave it at auto")
    return effects, False
