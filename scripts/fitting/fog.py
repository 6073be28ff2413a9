"""Fit how far behind the level of the depth maps the surface of a place lies, as a share of how thick its fog is.

Each folder of the corpus holds a trained splat and its truth, as scripts/score takes them. Each splat is meshed once,
and its vertices are moved by every share. That one is chosen whose least gain, of any scene at any distance, is the
largest: no scene pays for another. Beside each stands how it fares by the share that the others choose.
"""

import numpy as np

SHARES = (0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5)


class _Caught(Exception):
    """Ends a conversion once its mesh is known."""


def scores(folder):
    """F-scores (S, 3) of a capture at SHARES."""
    from scenes.score import read_truth, score
    from splat2mesh import convert
    from splat2mesh.surface import behind_fog, place

    truth, found, own, given = read_truth(folder), [], behind_fog.behind_fog, behind_fog.SHARE

    def caught(*mesh):
        for behind_fog.SHARE in SHARES:
            found.append(score((own(*mesh), mesh[2]), truth.mesh, truth.centers, sphere=truth.sphere))
        raise _Caught

    place.behind_fog = caught
    try:
        convert(next(folder.rglob("point_cloud.ply")), detail="draft", texture="none", background="keep")
    except _Caught:
        pass
    finally:
        place.behind_fog, behind_fog.SHARE = own, given
    return np.array([[each[name] for name in each if name.startswith("F")] for each in found])


def chosen(found):
    """Number of the share that F-scores (N, S, 3) choose."""
    return (found / found[:, :1]).min(axis=(0, 2)).argmax()


def fit(corpus):
    """Print the scores of every scene, the share that all choose, and how each fares by that of the others."""
    names = sorted(folder.name for folder in corpus.iterdir() if folder.is_dir())
    found = np.array([scores(corpus / name) for name in names])
    for number, name in enumerate(names):
        for share, row in zip(SHARES, found[number], strict=True):
            print(f"{name} {share:4.2f}: " + "  ".join(f"{value:.3f}" for value in row))
        others = chosen(np.delete(found, number, axis=0))
        print(f"{name}: the others choose {SHARES[others]}, by which it has {found[number, others].round(3)}")
    print(f"all choose {SHARES[chosen(found)]}")
