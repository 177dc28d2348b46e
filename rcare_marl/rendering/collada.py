"""Reads the triangles and diffuse colours of COLLADA files, which robot descriptions often use."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Part = tuple[Array, npt.NDArray[np.int32], npt.NDArray[np.uint8] | None]
Element = ElementTree.Element


def read_collada(path: str | Path) -> list[Part]:
    """Return (vertices [n, 3], faces [m, 3], sRGB colours [n, 3] or None) of each part.

    Nodes' transforms, the unit and the up axis are applied, as Bullet does.

    Raises:
        ValueError: If the file is not COLLADA, or a part of it is malformed.
    """
    try:
        root = ElementTree.parse(path).getroot()
    except ElementTree.ParseError as error:
        raise ValueError(f"not XML: {error}") from error
    for element in root.iter():
        element.tag = element.tag.rsplit("}", 1)[-1]
    if root.tag != "COLLADA":
        raise ValueError(f"not COLLADA but <{root.tag}>")
    return _Reader(root).parts()


class _Reader:
    def __init__(self, root: Element) -> None:
        self.root = root
        self.by_id = {e.attrib["id"]: e for e in root.iter() if "id" in e.attrib}

    def parts(self) -> list[Part]:
        unit = self.root.find("asset/unit")
        scale = float(unit.get("meter", "1")) if unit is not None else 1.0
        top = np.diag((scale, scale, scale, 1.0))
        axis = self.root.findtext("asset/up_axis", "Y_UP").strip()
        if axis == "Y_UP":
            turn = np.array(((1, 0, 0, 0), (0, 0, -1, 0), (0, 1, 0, 0), (0, 0, 0, 1)), float)
            top = turn @ top
        elif axis == "X_UP":
            turn = np.array(((0, -1, 0, 0), (1, 0, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)), float)
            top = turn @ top
        out: list[Part] = []
        for scene in self.root.iterfind("library_visual_scenes/visual_scene"):
            for node in scene.iterfind("node"):
                self._walk(node, top, out)
        return out

    def _walk(self, node: Element, above: Array, out: list[Part]) -> None:
        here = above @ _transform(node)
        for instance in node.iterfind("instance_geometry"):
            materials = {
                bind.get("symbol", ""): self._color(bind.get("target", ""))
                for bind in instance.iter("instance_material")
            }
            geometry = self.by_id[instance.attrib["url"][1:]]
            out.extend(self._geometry(geometry, here, materials))
        for instance in node.iterfind("instance_node"):
            self._walk(self.by_id[instance.attrib["url"][1:]], here, out)
        for child in node.iterfind("node"):
            self._walk(child, here, out)

    def _color(self, target: str) -> npt.NDArray[np.uint8] | None:
        material = self.by_id.get(target[1:])
        instance = material.find("instance_effect") if material is not None else None
        effect = self.by_id.get(instance.get("url", "#")[1:]) if instance is not None else None
        if effect is None:
            return None
        for diffuse in effect.iter("diffuse"):
            text = diffuse.findtext("color")
            if text:
                rgb = np.array([float(x) for x in text.split()[:3]])
                rounded: npt.NDArray[np.uint8] = np.round(rgb.clip(0, 1) * 255).astype(np.uint8)
                return rounded
        return None

    def _geometry(
        self,
        geometry: Element,
        transform: Array,
        materials: dict[str, npt.NDArray[np.uint8] | None],
    ) -> list[Part]:
        out: list[Part] = []
        mesh = geometry.find("mesh")
        for kind in ("triangles", "polylist", "polygons") if mesh is not None else ():
            for primitive in mesh.iterfind(kind) if mesh is not None else ():
                faces, source = self._faces(primitive)
                if not len(faces):
                    continue
                points = self._points(source)
                vertices = points @ transform[:3, :3].T + transform[:3, 3]
                if np.linalg.det(transform[:3, :3]) < 0:
                    faces = faces[:, ::-1]
                color = materials.get(primitive.get("material", ""))
                colors = None if color is None else np.tile(color, (len(vertices), 1))
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

    def _faces(self, primitive: Element) -> tuple[npt.NDArray[np.int64], str]:
        inputs = primitive.findall("input")
        stride = 1 + max(int(i.get("offset", "0")) for i in inputs)
        vertex = next(i for i in inputs if i.get("semantic") == "VERTEX")
        offset, source = int(vertex.get("offset", "0")), vertex.attrib["source"][1:]
        runs = [np.array((p.text or "").split(), np.int64) for p in primitive.iterfind("p")]
        runs = [run.reshape(-1, stride)[:, offset] for run in runs]
        if primitive.tag == "triangles":
            return np.concatenate([run.reshape(-1, 3) for run in runs]), source
        if primitive.tag == "polylist":
            counts = np.array(primitive.findtext("vcount", "").split(), np.int64)
            runs = np.split(np.concatenate(runs), np.cumsum(counts)[:-1])
        fans = [
            np.stack((np.full(len(run) - 2, run[0]), run[1:-1], run[2:]), axis=1)
            for run in runs
            if len(run) >= 3
        ]
        return (np.concatenate(fans) if fans else np.empty((0, 3), np.int64)), source


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
            x, y, z = values[:3] / np.linalg.norm(values[:3])
            cross = np.array(((0, -z, y), (z, 0, -x), (-y, x, 0)))
            angle = np.radians(values[3])
            matrix[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
        out = out @ matrix
    return out


__all__ = ["read_collada"]
