"""Reads the triangles and diffuse colours of COLLADA files, which robot descriptions often use."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import unquote
from xml.etree.ElementTree import Element

import numpy as np
import numpy.typing as npt
from PIL import Image

from ..pose import Array, axis_rotation
from ..reading import read_xml

Part = tuple[Array, npt.NDArray[np.int32], npt.NDArray[np.uint8] | None]
Paint = npt.NDArray[np.uint8]
Rows = npt.NDArray[np.int64]


def read_collada(path: str | Path) -> list[Part]:
    """Return (vertices [n, 3], faces [m, 3], sRGB colours [n, 3] or None) of each part.

    A picture gives its colours to the corners. Nodes' transforms and the unit are applied. The up
    axis is not: RViz and Gazebo ignore it, so descriptions of robots mix files that call y and z
    up (rviz issue 1045).

    Raises:
        ValueError: If the file is not COLLADA (a ConfigError if it cannot be read), or a part is malformed.
    """
    root = read_xml(path, "a mesh (COLLADA)")
    for element in root.iter():
        element.tag = element.tag.rsplit("}", 1)[-1]
    if root.tag != "COLLADA":
        raise ValueError(f"not COLLADA but <{root.tag}>")
    return _Reader(root, Path(path).parent).parts()


class _Reader:
    def __init__(self, root: Element, folder: Path) -> None:
        self.root, self.folder = root, folder
        self.by_id = {e.attrib["id"]: e for e in root.iter() if "id" in e.attrib}

    def parts(self) -> list[Part]:
        unit = self.root.find("asset/unit")
        scale = float(unit.get("meter", "1")) if unit is not None else 1.0
        top = np.diag((scale, scale, scale, 1.0))
        out: list[Part] = []
        for scene in self.root.iterfind("library_visual_scenes/visual_scene"):
            for node in scene.iterfind("node"):
                self._walk(node, top, out)
        return out

    def _walk(self, node: Element, above: Array, out: list[Part]) -> None:
        here = above @ _transform(node)
        for instance in node.iterfind("instance_geometry"):
            materials = {
                bind.get("symbol", ""): self._paint(bind.get("target", ""))
                for bind in instance.iter("instance_material")
            }
            geometry = self.by_id[instance.attrib["url"][1:]]
            out.extend(self._geometry(geometry, here, materials))
        for instance in node.iterfind("instance_node"):
            self._walk(self.by_id[instance.attrib["url"][1:]], here, out)
        for child in node.iterfind("node"):
            self._walk(child, here, out)

    def _paint(self, target: str) -> Paint | None:
        """Return the colour of a material, shape [3], or its picture, shape [h, w, 3]."""
        material = self.by_id.get(target[1:])
        instance = material.find("instance_effect") if material is not None else None
        effect = self.by_id.get(instance.get("url", "#")[1:]) if instance is not None else None
        if effect is None:
            return None
        for diffuse in effect.iter("diffuse"):
            rgb = np.array(diffuse.findtext("color", "").split()[:3], np.float64)
            if len(rgb):
                return np.round(rgb.clip(0, 1) * 255).astype(np.uint8)
            texture = diffuse.find("texture")
            if texture is not None:
                return self._picture(effect, texture.get("texture", ""))
        return None

    def _picture(self, effect: Element, name: str) -> Paint | None:
        """Return the picture that a texture means, through sampler and surface, if it is there."""
        inside = {e.get("sid"): e for e in effect.iter("newparam")}
        for tag in ("sampler2D/source", "surface/init_from"):
            parameter = inside.get(name)
            name = name if parameter is None else parameter.findtext(tag, name).strip()
        image = self.by_id.get(name)
        text = "" if image is None else image.findtext("init_from", "").strip()
        file = self.folder / Path(unquote(text.removeprefix("file://"))).name
        if not text or not file.is_file():
            return None
        with Image.open(file) as picture:
            return np.asarray(picture.convert("RGB"))

    def _geometry(
        self,
        geometry: Element,
        transform: Array,
        materials: dict[str, Paint | None],
    ) -> list[Part]:
        out: list[Part] = []
        mesh = geometry.find("mesh")
        for kind in ("triangles", "polylist", "polygons"):
            for primitive in mesh.iterfind(kind) if mesh is not None else ():
                rows, corners = self._corners(primitive)
                if not len(corners):
                    continue
                vertex, place = (_input(primitive, word) for word in ("VERTEX", "TEXCOORD"))
                if vertex is None:
                    raise ValueError(f"a <{kind}> has no vertices")
                points, faces = self._points(vertex[1]), rows[corners, vertex[0]]
                paint = materials.get(primitive.get("material", ""))
                colors = None
                if paint is not None and paint.ndim == 1:
                    colors = np.tile(paint, (len(points), 1))
                elif paint is not None and place is not None:
                    # Each corner has a place of its own in the picture.
                    points, faces = points[faces.ravel()], np.arange(faces.size).reshape(-1, 3)
                    uv = self._points(place[1])[:, :2]
                    colors = _sampled(paint, uv[rows[corners.ravel(), place[0]]])
                vertices = points @ transform[:3, :3].T + transform[:3, 3]
                if np.linalg.det(transform[:3, :3]) < 0:
                    faces = faces[:, ::-1]
                out.append((vertices, faces.astype(np.int32), colors))
        return out

    def _points(self, source: str) -> Array:
        element = self.by_id[source]
        if element.tag == "vertices":
            for given in element.iterfind("input"):
                if given.get("semantic") == "POSITION":
                    element = self.by_id[given.attrib["source"][1:]]
        values = np.array(element.findtext("float_array", "").split(), np.float64)
        accessor = element.find("technique_common/accessor")
        stride = int(accessor.get("stride", "3")) if accessor is not None else 3
        return values.reshape(-1, stride)[:, :3]

    def _corners(self, primitive: Element) -> tuple[Rows, Rows]:
        """Return the indices that a primitive gives, one row a corner, and its triangles of rows."""
        inputs = primitive.findall("input")
        stride = 1 + max(int(i.get("offset", "0")) for i in inputs)
        runs = [np.array((p.text or "").split(), np.int64) for p in primitive.iterfind("p")]
        none = np.empty((0, stride), np.int64)
        rows = np.concatenate([none, *(run.reshape(-1, stride) for run in runs)])
        if primitive.tag == "triangles":
            return rows, np.arange(len(rows)).reshape(-1, 3)
        counts = np.array([len(run) // stride for run in runs], np.int64)
        if primitive.tag == "polylist":
            counts = np.array(primitive.findtext("vcount", "").split(), np.int64)
        fans = [
            np.stack((np.full(n - 2, at), at + np.arange(1, n - 1), at + np.arange(2, n)), axis=1)
            for at, n in zip(np.cumsum(counts) - counts, counts, strict=True)
            if n >= 3
        ]
        return rows, np.concatenate(fans) if fans else np.empty((0, 3), np.int64)


def _input(primitive: Element, semantic: str) -> tuple[int, str] | None:
    """Return offset and source of the first input of a meaning."""
    for given in primitive.iterfind("input"):
        if given.get("semantic") == semantic:
            return int(given.get("offset", "0")), given.attrib["source"][1:]
    return None


def _sampled(picture: Paint, places: Array) -> npt.NDArray[np.uint8]:
    """Return the colours of a picture at texture coordinates, shape [n, 2], repeating it."""
    height, width = picture.shape[:2]
    u, v = (places - np.floor(places)).T
    row = np.minimum(((1 - v) * height).astype(int), height - 1)
    return picture[row, np.minimum((u * width).astype(int), width - 1)]


def _transform(node: Element) -> Array:
    out = np.eye(4)
    for step in node:
        if step.tag not in ("matrix", "translate", "rotate", "scale"):
            continue
        values = np.array((step.text or "").split(), np.float64)
        matrix = np.eye(4)
        if step.tag == "matrix":
            matrix = values.reshape(4, 4)
        elif step.tag == "translate":
            matrix[:3, 3] = values
        elif step.tag == "scale":
            matrix[:3, :3] = np.diag(values)
        else:
            axis, angle = values[:3] / np.linalg.norm(values[:3]), np.radians(values[3])
            matrix[:3, :3] = axis_rotation(axis, float(angle))
        out = out @ matrix
    return out
