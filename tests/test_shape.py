"""Shapes and their surfaces: where they are, how true and how cheap they are, what is written of them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from rcare_marl.model.mesh import Mesh
from rcare_marl.model.shape import Shape, surface
from rcare_marl.pose import Pose, quaternion_from_rpy

PATH = ((0.0, 0.0, 0.0), (0.4, 0.0, 0.1), (0.4, 0.3, 0.2))
SQUARE = ((0.0, 0.0, 0.1), (1.0, 0.0, 0.1), (1.0, 1.0, 0.1), (0.0, 1.0, 0.1))
AT, RPY = (0.1, -0.2, 0.3), (0.3, -0.4, 1.0)
SHAPES = {
    "box": Shape("box", at=AT, rpy=RPY, size=(0.2, 0.3, 0.4)),
    "stretched box": Shape("box", at=AT, rpy=RPY, size=(0.2, 0.3, 0.4), scale=(1.0, 2.0, 0.5)),
    "rounded box": Shape("box", at=AT, rpy=RPY, size=(0.2, 0.3, 0.4), bevel=0.06),
    "sphere": Shape("sphere", at=AT, radius=0.2, scale=(1.0, 2.0, 0.5)),
    "cylinder": Shape("cylinder", at=AT, rpy=RPY, radius=0.1, length=0.4),
    "cylinder between points": Shape("cylinder", points=PATH[:2], radius=0.1),
    "capsule between points": Shape("capsule", points=PATH[1:], radius=0.1),
    "lathe": Shape("lathe", at=AT, rpy=RPY, profile=((0.2, 0.0), (0.3, 0.2), (0.1, 0.5))),
    "loft": Shape("loft", at=AT, sections=((0.0, 0.0, 0.0, 0.1, 0.2), (0.5, 0.1, 0.0, 0.2, 0.1))),
    "rod": Shape("tube", at=AT, rpy=RPY, points=PATH[:2], radius=0.02),
    "tube": Shape("tube", at=AT, rpy=RPY, points=PATH, radius=0.02, bend=0.1),
    "quads": Shape("quads", at=AT, rpy=RPY, points=SQUARE),
}
CLOSED = [name for name in SHAPES if name != "quads"]


def volume(mesh: Mesh) -> float:
    """Return what a closed mesh holds [m³]; negative where it is inside out."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def reach(mesh: Mesh, direction: np.ndarray) -> float:
    """Return how far a mesh reaches in a direction [m]."""
    return float((mesh.vertices @ direction).max())


@pytest.mark.parametrize("name", SHAPES)
def test_a_moved_shape_is_where_its_surface_would_be_moved_to(name: str) -> None:
    shape = SHAPES[name]
    pose = Pose((1.0, 2.0, 3.0), tuple(quaternion_from_rpy(0.5, 0.2, -2.0).tolist()))
    moved, wanted = shape.moved(pose).mesh(), shape.mesh().moved(pose)
    assert len(moved.vertices) == len(wanted.vertices)
    for direction in np.random.default_rng(0).normal(size=(20, 3)):
        unit = direction / np.linalg.norm(direction)
        assert reach(moved, unit) == pytest.approx(reach(wanted, unit), abs=2e-3), name
    np.testing.assert_allclose(moved.vertices.mean(axis=0), wanted.vertices.mean(axis=0), atol=1e-9)
    np.testing.assert_allclose(shape.mesh(pose).vertices, wanted.vertices, atol=1e-12)


@pytest.mark.parametrize("name", SHAPES)
def test_bounds_are_those_of_the_surface(name: str) -> None:
    low, high = SHAPES[name].bounds()
    vertices = SHAPES[name].mesh().vertices
    if name != "rounded box":  # its corners reach a little less far than those of a sharp one
        np.testing.assert_allclose(low, vertices.min(axis=0), atol=1e-9)
        np.testing.assert_allclose(high, vertices.max(axis=0), atol=1e-9)
    assert (low <= vertices.min(axis=0) + 1e-9).all()
    assert (high >= vertices.max(axis=0) - 1e-9).all()


@pytest.mark.parametrize("name", CLOSED)
def test_a_coarse_shape_has_fewer_triangles_and_stays_true(name: str) -> None:
    fine, coarse = SHAPES[name], SHAPES[name].coarse(0.0025)
    if name not in ("box", "stretched box", "loft"):
        assert len(coarse.mesh().faces) < len(fine.mesh().faces)
    assert volume(coarse.mesh()) > 0
    for direction in np.eye(3):
        assert reach(coarse.mesh(), direction) == pytest.approx(
            reach(fine.mesh(), direction), abs=0.005
        )
    assert coarse.coarse(0.1) == coarse  # what has been chosen stays


@pytest.mark.parametrize("name", CLOSED)
def test_normals_look_out_and_have_length_one(name: str) -> None:
    mesh = SHAPES[name].mesh().shaded()
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-9)
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    flat = np.cross(b - a, c - a)
    for k in range(3):
        along = np.einsum("ij,ij->i", flat, mesh.normals[mesh.corners[:, k]])
        assert (along > 0.5 * np.linalg.norm(flat, axis=1) - 1e-12).all()


def test_shapes_drawn_together_are_what_each_is_alone() -> None:
    shapes = [SHAPES[name] for name in CLOSED]
    pose = Pose((0.0, 1.0, 0.0), tuple(quaternion_from_rpy(0.0, 0.0, 1.0).tolist()))
    together, alone = surface(shapes, pose), [shape.mesh(pose) for shape in shapes]
    assert len(together.faces) == sum(len(mesh.faces) for mesh in alone)
    assert volume(together) == pytest.approx(sum(volume(mesh) for mesh in alone))


def test_what_is_written_is_what_was_drawn() -> None:
    mesh = surface([SHAPES["rounded box"], SHAPES["tube"], SHAPES["box"]])
    text = mesh.obj()
    assert text == surface([SHAPES["rounded box"], SHAPES["tube"], SHAPES["box"]]).obj()
    rows = [line.split() for line in text.splitlines()]
    vertices = np.array([row[1:] for row in rows if row[0] == "v"], float)
    normals = np.array([row[1:] for row in rows if row[0] == "vn"], float)
    corners = np.array([c.split("//") for row in rows if row[0] == "f" for c in row[1:]], int) - 1
    np.testing.assert_allclose(vertices, mesh.vertices, atol=1e-5)
    assert (corners[:, 0].reshape(-1, 3) == mesh.faces).all()
    np.testing.assert_allclose(
        normals[corners[:, 1]], mesh.normals[mesh.corners.reshape(-1)], atol=3e-4
    )
    assert len(np.unique(normals, axis=0)) == len(normals)  # each is written once


@pytest.mark.parametrize("name", SHAPES)
def test_a_shape_shows_what_makes_it_again(name: str) -> None:
    assert eval(repr(SHAPES[name])) == SHAPES[name]
    assert "bend=0.0" not in repr(SHAPES[name])


def test_a_rounded_box_is_as_large_as_it_says_and_holds_what_it_should() -> None:
    edges, bevel = np.array((0.3, 0.4, 0.5)), 0.1
    for steps in (1, 2, 8):
        mesh = Shape("box", size=tuple(edges.tolist()), bevel=bevel, steps=steps).mesh()
        np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), edges)
    inner = edges - 2 * bevel
    sides = 2 * bevel * (inner[0] * inner[1] + inner[1] * inner[2] + inner[2] * inner[0])
    round_edges = math.pi * bevel**2 * inner.sum()
    whole = inner.prod() + sides + round_edges + 4 / 3 * math.pi * bevel**3
    assert volume(mesh) == pytest.approx(whole, rel=5e-3)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"kind": "box", "size": (1.0, 1.0, 1.0), "segments": 8}, "cannot have 8"),
        ({"kind": "sphere", "radius": 1.0, "segments": 2}, "cannot have 2"),
        ({"kind": "sphere", "radius": 1.0, "steps": 2}, "2 `steps`"),
        ({"kind": "box", "size": (1.0, 1.0, 1.0), "steps": -1}, "-1 `steps`"),
        ({"kind": "lathe"}, "needs `profile`"),
    ],
)
def test_a_shape_that_cannot_be_is_refused(fields: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Shape(**fields)
