"""Cameras like given ones, from all round what they look at."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from splatcore.model.formats.file import input_error
from splatcore.spec.camera import Camera

GAP = np.radians(3.5)  # no view looks within this of the direction in which a given camera looks
TRIES = 8  # views that are tried for each that is wanted; those that lie farthest apart are taken
UPRIGHT = 1e-3  # weight of −y as up beside the cameras' own up; it decides for one camera

NEAR_MIDDLE = 1e-4
"""Weight of the middle beside the point that the cameras look at; it decides for one camera."""

BESIDE = {
    "5 degrees": (np.radians(5), 1.0),
    "15 degrees": (np.radians(15), 1.0),
    "nearer": (0.0, 0.8),
    "farther": (0.0, 1.2),
}
"""Views beside a path: how far off it, about what is looked at, and factor of the distance."""


def orbiting_views(
    cameras: list[Camera],
    middle: np.ndarray,
    count: int,
    rise: float,
    nearer: float,
    seed: int = 0,
    outward: bool = False,
) -> list[Camera]:
    """`count` views: the cameras in turn, turned about the upright line through what they look at
    together, raised by up to ±`rise` radians, at 1/`nearer` … `nearer` times their distance.

    Rises are drawn evenly, or with `outward` more densely the larger they are.

    What the cameras look at is the point nearest to their axes; `middle` [3] is where on its axis a
    single camera looks. No view looks within GAP of where a camera does (less where cameras leave
    no room for that): pictures from the cameras can judge what was learned. The same arguments give
    the same views.

    Raises InputError for no camera, and for a count below 1.
    """
    from scipy.spatial.transform import Rotation  # takes half a second

    if not cameras:
        raise input_error("cameras", "there are none")
    if count < 1:
        raise input_error("count", f"{count} is not ≥ 1")
    centre, up = looked_at(cameras, middle), upright(cameras)
    ahead = np.array([camera.rotation[2] for camera in cameras])
    rng = np.random.default_rng(seed)
    tried, number = [], 0
    while len(tried) < TRIES * count:
        camera = cameras[number % len(cameras)]
        turn = Rotation.from_rotvec(rng.uniform(0, 2 * np.pi) * up)
        raised = rng.uniform(-rise, rise)
        if outward:
            raised = np.copysign(np.sqrt(rise * abs(raised)), raised)
        turn *= Rotation.from_rotvec(raised * camera.rotation[0])
        view = moved(camera, centre, turn.as_matrix(), nearer ** rng.uniform(-1, 1))
        gap = GAP * 0.5 ** (number // (4 * TRIES * count))
        if (ahead @ view.rotation[2] < np.cos(gap)).all():
            tried.append(view)
        number += 1
    chosen = spread(np.array([view.position for view in tried]), count)
    return [replace(tried[k], name=f"orbit {number}") for number, k in enumerate(chosen)]


def views_beside(cameras: Sequence[Camera], middle: np.ndarray) -> dict[str, list[Camera]]:
    """By the names of `BESIDE` a view beside each camera: raised and lowered in turns, nearer, and
    farther. middle: as for `orbiting_views`."""
    from scipy.spatial.transform import Rotation  # takes half a second

    centre, found = looked_at(cameras, middle), {}
    for name, (angle, away) in BESIDE.items():
        turns = [
            Rotation.from_rotvec((-1) ** k * angle * camera.rotation[0]).as_matrix()
            for k, camera in enumerate(cameras)
        ]
        found[name] = [
            moved(camera, centre, turn, away) for camera, turn in zip(cameras, turns, strict=True)
        ]
    return found


def spread(points: np.ndarray, count: int) -> list[int]:
    """Indices of `count` of `points` [M, 3] that lie far apart: the first, then always the farthest
    from those chosen before it."""
    chosen, away = [], np.full(len(points), np.inf)
    for _ in range(count):
        chosen.append(int(away.argmax()))
        away = np.minimum(away, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return chosen


def moved(camera: Camera, centre: np.ndarray, turn: np.ndarray, away: float) -> Camera:
    """The camera turned about `centre` [3] by the rotation `turn` [3, 3], and moved to `away` times
    its distance."""
    position = centre + away * (turn @ (camera.position - centre))
    rotation = camera.rotation @ turn.T
    return replace(camera, rotation=rotation, translation=-rotation @ position)


def looked_at(cameras: Sequence[Camera], middle: np.ndarray) -> np.ndarray:
    """The point [3] with the least squared distances from the cameras' axes."""
    matrix, wanted = NEAR_MIDDLE * np.eye(3), NEAR_MIDDLE * np.asarray(middle, float)
    for camera in cameras:
        ahead = camera.rotation[2]
        across = np.eye(3) - np.outer(ahead, ahead)
        matrix, wanted = matrix + across, wanted + across @ camera.position
    return np.linalg.solve(matrix, wanted)


def upright(cameras: Sequence[Camera]) -> np.ndarray:
    """Up [3], of length 1: as nearly as can be at right angles to the rows of all pictures.

    A photographer holds the camera level; the scene's frame may be any.
    """
    level = np.array([camera.rotation[0] for camera in cameras])
    matrix = level.T @ level / len(level) - UPRIGHT * np.diag([0.0, 1.0, 0.0])
    up = np.linalg.eigh(matrix)[1][:, 0]
    down = np.mean([camera.rotation[1] for camera in cameras], axis=0)
    return -up if up @ down > 0 else up
