"""Fit how far behind the level of the depth maps the surface of a place lies, as a share of how thick its fog is.

Each folder of the corpus holds a trained splat and its truth, as scripts/score takes them. Each splat is meshed once,
and its vertices are moved by every share. The mean of the F-scores of all scenes chooses; the error printed beside each
is that of the share that the others choose.
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


def fit(corpus):
    """Print the scores of every scene, the share that all choose, and how each fares by that of the others."""
    names = sorted(folder.name for folder in corpus.iterdir() if folder.is_dir())
    found = np.array([scores(corpus / name) for name in names])
    means = found.mean(axis=2)
    for name, table, others in zip(names, found, (means.sum(axis=0) - means), strict=True):
        for share, row in zip(SHARES, table, strict=True):
            print(f"{name} {share:4.2f}: " + "  ".join(f"{value:.3f}" for value in row))
        print(f"{name}: the others choose {SHARES[others.argmax()]}, mean {table[others.argmax()].mean():.3f}")
    print(f"all choose {SHARES[means.mean(axis=0).argmax()]}")
