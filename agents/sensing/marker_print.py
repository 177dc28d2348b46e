"""What is printed on a marker: its cells, and the plate that they are drawn on as coloured quads."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rcare_marl.cache import cached
from rcare_marl.model.mesh import Mesh
from rcare_marl.model.shape import MeshFile
from rcare_marl.model.urdf import Joint, Link, Model, write
from rcare_marl.pose import Array

DICTIONARIES = (
    *(f"{n}x{n}_{count}" for n in (4, 5, 6, 7) for count in (50, 100, 250, 1000)),
    "apriltag_16h5",
    "apriltag_25h9",
    "apriltag_36h10",
    "apriltag_36h11",
    "aruco_mip_36h12",
    "aruco_original",
)
MARGIN = 1  # [cell] of white round the black border; a detector needs it
THICKNESS = 0.001  # [m], a print glued on card; our own choice
MASS = 0.001  # [kg]; nothing feels it
WHITE = (0.92, 0.92, 0.90, 1.0)  # paper and toner; our own choice
BLACK = (0.03, 0.03, 0.03, 1.0)


def dictionary(name: str) -> Any:
    """Return OpenCV's dictionary of that name, one of `DICTIONARIES`."""
    import cv2  # takes a tenth of a second, and most scenes have no markers

    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name.upper()}"))


def dictionary_size(name: str) -> int:
    """Return how many markers a dictionary has."""
    return int(dictionary(name).bytesList.shape[0])


def cells(name: str, number: int) -> Array:
    """Return the cells of a marker with its black border and white margin, 1 for white.

    Rows go down and columns go right in the print, shape [n, n].
    """
    import cv2

    book = dictionary(name)
    inner = cv2.aruco.generateImageMarker(book, number, book.markerSize + 2)
    return np.pad(np.asarray(inner, np.float64) / 255, MARGIN, constant_values=1.0)


def plate_edge(name: str, size: float) -> float:
    """Return the edge of the plate of a marker whose black square has the edge `size` [m]."""
    inner = int(dictionary(name).markerSize) + 2
    return size * (inner + 2 * MARGIN) / inner


def plate_urdf(name: str, number: int, size: float) -> Path:
    """Return the URDF of a plate; its frame is the marker's: x right, y up, z out of the print."""
    white, black = _sides(cells(name, number), plate_edge(name, size))
    label = f"marker_{name}_{number}"
    files = [
        MeshFile(str(cached(f"{label}_{color}", ".obj", surface.obj())), rgba)
        for color, surface, rgba in (("white", white, WHITE), ("black", black, BLACK))
    ]
    edge = plate_edge(name, size)
    flat = MASS * edge**2 / 12
    model = Model(
        name=label,
        source="OpenCV's dictionary of markers",
        # A link beside the base: the renderers take a body without one for something that stands still.
        links={"base": Link(), "plate": Link(MASS, inertia=(flat, 0, 0, flat, 0, 2 * flat))},
        joints={"plate": Joint("fixed", "base", "plate")},
    )
    return write(model, visuals={"plate": tuple(files)})


def _sides(pattern: Array, edge: float) -> tuple[Mesh, Mesh]:
    """Return what is white, with the sides and the back of the plate, and what is black.

    Cells share their corners, so that no gap opens between them.
    """
    count = len(pattern)
    ticks = np.linspace(-edge / 2, edge / 2, count + 1)
    x, y = np.meshgrid(ticks, ticks[::-1])
    top = np.column_stack((x.ravel(), y.ravel(), np.zeros(x.size)))
    rows, columns = np.divmod(np.arange(count * count), count)
    corner = rows * (count + 1) + columns  # upper left of each cell
    quads = np.stack((corner, corner + count + 1, corner + count + 2, corner + 1), axis=1)
    faces = quads[:, ((0, 1, 2), (0, 2, 3))]
    is_white = pattern.ravel() > 0.5
    rim = np.concatenate(  # counter-clockwise from above, from the upper left
        (
            np.arange(count + 1) * (count + 1),
            count * (count + 1) + np.arange(1, count + 1),
            (np.arange(count - 1, -1, -1) + 1) * (count + 1) - 1,
            np.arange(count - 1, 0, -1),
        )
    )
    start = len(top)
    below = start + np.arange(len(rim))
    after = np.roll(np.arange(len(rim)), -1)
    sides = [np.stack((rim, below, below[after]), axis=1)]
    sides.append(np.stack((rim, below[after], rim[after]), axis=1))
    a, b, c, d = (start + i * count for i in range(4))
    back = np.array(((a, c, b), (a, d, c)))
    vertices = np.concatenate((top, top[rim] - (0.0, 0.0, THICKNESS)))
    white = np.concatenate((faces[is_white].reshape(-1, 3), *sides, back))
    return _used(vertices, white), _used(vertices, faces[~is_white].reshape(-1, 3))


def _used(vertices: Array, faces: Array) -> Mesh:
    """Return a mesh without the vertices that no face uses."""
    used, index = np.unique(faces, return_inverse=True)
    return Mesh(vertices[used], index.reshape(-1, 3))
