"""Child process of `usd`: writes the arrays of the Gaussians in a USD stage to an .npz.

`python usd_arrays.py STAGE ARRAYS.npz MEMORY`: imports usd-core and numpy alone. MEMORY bounds the
address space of the process in bytes. Prints the reason if it fails, with status 1.
"""

import sys

import numpy as np

CLASS = "ParticleField3DGaussianSplat"

ARRAYS = {
    "position": "positions",
    "quaternion": "orientations",
    "scale": "scales",
    "opacity": "opacities",
    "sh": "radiance:sphericalHarmonicsCoefficients",
}
"""Field of a scene → attribute; its twin of half floats has an h at the end."""


def bound(memory: int) -> None:
    """Bound the address space, where the system can."""
    try:
        import resource
    except ImportError:  # Windows
        return
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))


def value(prim, name: str, time):
    """An attribute's value at its first time; None if it has none."""
    attribute = prim.GetAttribute(name)
    return attribute.Get(time) if attribute else None


def arrays(prim, time) -> dict[str, np.ndarray]:
    """The stored arrays of a prim, floats before half floats."""
    found = {}
    for field, name in ARRAYS.items():
        for attribute in (name, name + "h"):
            stored = value(prim, attribute, time)
            if stored is not None and len(stored):
                found[field] = np.array(stored, np.float32)
                break
    degree = value(prim, "radiance:sphericalHarmonicsDegree", time)
    found["degree"] = np.array(3 if degree is None else degree)
    return found


def main(source: str, target: str, memory: int) -> None:
    bound(memory)
    from pxr import Usd, UsdGeom

    stage, time = Usd.Stage.Open(source), Usd.TimeCode.EarliestTime()
    transforms = UsdGeom.XformCache(time)
    out, paths, hidden = {}, [], 0
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        if prim.GetTypeName() != CLASS:
            continue
        if UsdGeom.Imageable(prim).ComputeVisibility(time) == UsdGeom.Tokens.invisible:
            hidden += 1
            continue
        matrix = transforms.GetLocalToWorldTransform(prim)  # maps rows
        found = arrays(prim, time) | {"matrix": np.array(matrix, np.float64).T}
        out |= {f"{len(paths)} {name}": array for name, array in found.items()}
        paths.append(str(prim.GetPath()))
    up = str(UsdGeom.GetStageUpAxis(stage))
    np.savez(target, paths=np.array(paths, str), hidden=hidden, up=up, **out)


def reason(error: Exception) -> str:
    """The reason of an error: the first of those that an exception of usd-core holds."""
    comments = [held.commentary for held in error.args if hasattr(held, "commentary")]
    return comments[0] if comments else str(error) or type(error).__name__


if __name__ == "__main__":
    try:
        main(sys.argv[1], sys.argv[2], int(sys.argv[3]))
    except Exception as error:
        print(reason(error))
        sys.exit(1)
