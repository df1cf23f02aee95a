"""Views that orbit the point that given cameras look at."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from splatcore.model.formats.file import input_error
from splatcore.spec.camera import Camera

GAP = np.radians(3.5)  # smallest angle between the axes of a view and of any given camera
TRIES = 8  # candidates per view; the candidates farthest apart are taken
UPRIGHT = 1e-3  # weight of −y as up against the cameras' own up; decides if there is one camera

NEAR_MIDDLE = 1e-4
"""Weight of the scene's middle against the point that the cameras look at; decides if there is one
camera."""

BESIDE = {
    "5 degrees": (np.radians(5), 1.0),
    "15 degrees": (np.radians(15), 1.0),
    "nearer": (0.0, 0.8),
    "farther": (0.0, 1.2),
}
"""Views off a path: angle (radians) about the point looked at, and factor of the distance."""


def orbiting_views(
    cameras: list[Camera],
    middle: np.ndarray,
    count: int,
    rise: float,
    nearer: float,
    seed: int = 0,
    outward: bool = False,
) -> list[Camera]:
    """Choose `count` views that orbit the point the cameras look at; deterministic.

    Each view is one of the cameras, in turn, rotated about the upright line through the point
    nearest to all camera axes.

    middle: [3] the point that a single camera looks at, projected onto its axis
    rise: views are raised or lowered by up to `rise` radians
    nearer: distances are 1/`nearer` … `nearer` times the camera's
    outward: large rises are more frequent; otherwise all are equally likely

    No view's axis is within GAP of a camera's (GAP shrinks if the cameras leave no room), so that
    pictures from the cameras remain a fair test. Raises InputError without cameras, and for a
    count below 1.
    """
    from scipy.spatial.transform import Rotation  # takes half a second

    if not cameras:
        raise input_error("cameras", "none given; at least one is needed")
    if count < 1:
        raise input_error("count", f"{count} is below 1")
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
    """Views off the path, one per camera, for each name of `BESIDE`; they are raised and lowered
    alternately.

    middle: [3], as for `orbiting_views`
    """
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
    """Indices of `count` of `points` [M, 3] that are far apart: the first point, then each time the
    point farthest from all points already chosen."""
    chosen, away = [], np.full(len(points), np.inf)
    for _ in range(count):
        chosen.append(int(away.argmax()))
        away = np.minimum(away, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return chosen


def moved(camera: Camera, centre: np.ndarray, turn: np.ndarray, away: float) -> Camera:
    """The camera rotated about `centre` [3] by `turn` [3, 3], at `away` times its distance."""
    position = centre + away * (turn @ (camera.position - centre))
    rotation = camera.rotation @ turn.T
    return replace(camera, rotation=rotation, translation=-rotation @ position)


def looked_at(cameras: Sequence[Camera], middle: np.ndarray) -> np.ndarray:
    """The point [3] nearest to the cameras' axes, by least squares."""
    matrix, wanted = NEAR_MIDDLE * np.eye(3), NEAR_MIDDLE * np.asarray(middle, float)
    for camera in cameras:
        ahead = camera.rotation[2]
        across = np.eye(3) - np.outer(ahead, ahead)
        matrix, wanted = matrix + across, wanted + across @ camera.position
    return np.linalg.solve(matrix, wanted)


def upright(cameras: Sequence[Camera]) -> np.ndarray:
    """The upward unit vector [3]: as nearly perpendicular as possible to the rows of all pictures.

    Photographers hold the camera level, whatever the coordinate frame of the scene.
    """
    level = np.array([camera.rotation[0] for camera in cameras])
    matrix = level.T @ level / len(level) - UPRIGHT * np.diag([0.0, 1.0, 0.0])
    up = np.linalg.eigh(matrix)[1][:, 0]
    down = np.mean([camera.rotation[1] for camera in cameras], axis=0)
    return -up if up @ down > 0 else up
