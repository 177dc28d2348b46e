"""A URDF as XML and as a tree: common untidiness does no harm, and what is wrong is said with its place."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path
from xml.etree import ElementTree as xml
from xml.parsers import expat

from rcare_marl.errors import ConfigError, UnknownNameError, shown

from ..reading import DEPTH, LARGEST_TEXT, read_bytes, reason
from .shape import Triple
from .urdf import Follow, Joint

FARTHEST = 1e6  # of a place [m], an angle [rad] or a scale
LARGEST = 1e30  # of any number, so that its square is one too
_NAMED = ("link", "joint", "material")
_DEFINITIONS = ("xacro:property", "xacro:arg")


class Document:
    """A URDF file whose elements know their lines.

    Prefixes that nobody declared are taken as part of the tag, so such tags are merely unknown.

    Attributes:
        path: The file.
        root: Its `<robot>` element.
    """

    def __init__(self, path: str | Path) -> None:
        """Read a file.

        Raises:
            ConfigError: If there is no such file, or it is not XML, not a URDF, or xacro still.
        """
        self.path = Path(path)
        self._lines: dict[xml.Element, int] = {}
        self._parents: dict[xml.Element, xml.Element] = {}
        self.root = self._parse(self._bytes())
        self._check_kind()

    def fault(self, element: xml.Element, message: str) -> ConfigError:
        """Return an error that names the file, the line and the element."""
        place, here = [], element
        while here is not self.root:
            name = here.get("name") if here.tag in _NAMED else None
            place.append(f"{here.tag} {name!r}" if name is not None else here.tag)
            here = self._parents[here]
        where = " > ".join(reversed(place)) or "robot"
        return ConfigError(f"{self.path}, line {self._lines[element]}, {where}: {message}")

    def text(self, element: xml.Element, attribute: str) -> str:
        """Return an attribute that must be there."""
        value = element.get(attribute, "").strip()
        if not value:
            raise self.fault(element, f'it needs {attribute}="..."')
        return value

    def number(self, element: xml.Element, attribute: str, default: float | None = None) -> float:
        """Return an attribute that is one number; it must be there if there is no default."""
        fallback = None if default is None else (default,)
        return self.numbers(element, attribute, 1, fallback)[0]

    def numbers(
        self,
        element: xml.Element,
        attribute: str,
        count: int,
        default: Sequence[float] | None = None,
    ) -> tuple[float, ...]:
        """Return an attribute that is `count` finite numbers apart by spaces."""
        if default is not None and element.get(attribute) is None:
            return tuple(default)
        text = self.text(element, attribute)
        try:
            values = tuple(float(word) for word in text.split())
        except ValueError:
            values = ()
        if len(values) != count or not all(abs(value) <= LARGEST for value in values):
            wanted = "a finite number" if count == 1 else f"{count} finite numbers apart by spaces"
            raise self.fault(element, f"{attribute} must be {wanted}, got {shown(text)}")
        return values

    def triple(self, element: xml.Element, attribute: str, default: Triple | None = None) -> Triple:
        """Return an attribute that is three numbers."""
        x, y, z = self.numbers(element, attribute, 3, default)
        if max(abs(x), abs(y), abs(z)) > FARTHEST:
            raise self.fault(element, f"{attribute} must lie within {FARTHEST:g}, got {x} {y} {z}")
        return x, y, z

    def child(self, element: xml.Element, tag: str) -> xml.Element:
        """Return a child that must be there."""
        found = element.find(tag)
        if found is None:
            raise self.fault(element, f"it needs a <{tag}>")
        return found

    def named(self, tag: str) -> dict[str, xml.Element]:
        """Return the elements of `tag` right below the root by name; no name may stand twice."""
        out: dict[str, xml.Element] = {}
        for element in self.root.findall(tag):
            name = self.text(element, "name")
            if name in out:
                raise self.fault(
                    element,
                    f"there is a {tag} of this name already, on line {self._lines[out[name]]}",
                )
            out[name] = element
        return out

    def _bytes(self) -> bytes:
        if os.path.isdir(self.path):
            inside = sorted(file.name for file in self.path.rglob("*.urdf"))
            raise ConfigError(
                f"{self.path} is a folder, not a URDF. URDFs in it: "
                f"{', '.join(inside[:5]) or 'none'}"
            )
        if not os.path.exists(self.path):
            raise ConfigError(f"no URDF at {self.path}.{self._neighbours()}")
        return read_bytes(self.path, "a URDF", most=LARGEST_TEXT)

    def _neighbours(self) -> str:
        folder = self.path.parent
        if not os.path.isdir(folder):
            return f" There is no folder {folder}"
        names = sorted(p.name for p in folder.iterdir() if p.suffix in (".urdf", ".xacro", ".xml"))
        near = get_close_matches(self.path.name, names, n=1)
        hint = f" Did you mean {near[0]!r}?" if near else ""
        return f"{hint} In {folder}: {', '.join(names[:8]) or 'no .urdf file'}"

    def _parse(self, data: bytes) -> xml.Element:
        parser, builder = expat.ParserCreate(), xml.TreeBuilder()
        text = data.lstrip()  # XML itself allows nothing before its first tag
        skipped = data[: len(data) - len(text)].count(b"\n")
        above: list[xml.Element] = []

        def start(tag: str, attributes: dict[str, str]) -> None:
            element = builder.start(tag, attributes)
            self._lines[element] = parser.CurrentLineNumber + skipped
            if above:
                self._parents[element] = above[-1]
            above.append(element)
            if len(above) > DEPTH:
                raise ConfigError(f"{self.path} is nested more than {DEPTH} deep")

        def end(tag: str) -> None:
            builder.end(tag)
            above.pop()

        parser.StartElementHandler, parser.EndElementHandler = start, end
        parser.CharacterDataHandler = builder.data
        try:
            parser.Parse(text, True)
        except expat.ExpatError as error:
            raise ConfigError(
                f"{self.path} is not XML: {expat.ErrorString(error.code)}, "
                f"line {error.lineno + skipped}, "
                f"column {error.offset + 1}"
            ) from error
        except (ValueError, LookupError) as error:  # of encodings
            if isinstance(error, ConfigError):
                raise
            raise ConfigError(f"{self.path} is not XML: {reason(error)}") from error
        return builder.close()

    def _check_kind(self) -> None:
        if self.root.tag != "robot":
            raise ConfigError(
                f"{self.path} is not a URDF: its outermost element is <{self.root.tag}>, expected "
                "<robot>"
            )
        for element in self.root.iter():
            # What only defines something is harmless, and often left over.
            if element.tag.startswith("xacro:") and element.tag not in _DEFINITIONS:
                raise self._unexpanded(element, f"<{element.tag}>")
        for top in self.root:
            for element in top.iter() if top.tag in _NAMED else ():
                for value in element.attrib.values():
                    if "${" in value or "$(" in value:
                        raise self._unexpanded(element, repr(value))

    def _unexpanded(self, element: xml.Element, what: str) -> ConfigError:
        name = self.path.name
        return ConfigError(
            f"{self.path}, line {self._lines[element]}: {what} says that this is a xacro file that "
            f"is not expanded yet. Expand it: `xacro {name} -o robot.urdf` (with ROS), or `pip "
            f"install xacrodoc` and `xacrodoc {name} -o robot.urdf`"
        )


def parents_first(
    links: Collection[str], joints: Mapping[str, Joint], file: Path
) -> dict[str, Joint]:
    """Return the joints in an order in which each comes after the one that carries it.

    Raises:
        ConfigError: If joints and links are not one tree; it names `file`.
    """
    carried: dict[str, str] = {}
    for name, joint in joints.items():
        for end in (joint.parent, joint.child):
            if end not in links:
                raise ConfigError(f"{file}: {UnknownNameError(f'link (joint {name})', end, links)}")
        if joint.child in carried:
            raise ConfigError(
                f"{file}: link {joint.child!r} hangs on two joints, {carried[joint.child]!r} and "
                f"{name!r}; a URDF is a tree, each link hangs on one"
            )
        carried[joint.child] = name
    roots = [name for name in links if name not in carried]
    if len(roots) > 1:
        raise ConfigError(
            f"{file}: {len(roots)} links hang on no joint: {_listed(roots)}; a URDF is one tree "
            "and has one such link, its root"
        )
    placed, left, out = set(roots), dict(joints), dict[str, Joint]()
    while left:
        ready = {name: joint for name, joint in left.items() if joint.parent in placed}
        if not ready:
            raise ConfigError(f"{file}: joints make a loop: {_loop(left)}; a URDF is a tree")
        for name, joint in ready.items():
            out[name] = left.pop(name)
            placed.add(joint.child)
    return out


def resolved(joints: Mapping[str, Joint], file: Path) -> dict[str, Joint]:
    """Return the joints with each follower of a follower following the first of them.

    Raises:
        ConfigError: If a joint follows one that is not there or is fixed, or in the end itself.
    """
    return {
        name: replace(joint, follows=_followed(name, joints, file))
        for name, joint in joints.items()
    }


def _followed(name: str, joints: Mapping[str, Joint], file: Path) -> Follow | None:
    rule = joints[name].follows
    seen = [name]
    while rule is not None:
        if rule.joint not in joints:
            known = [other for other, joint in joints.items() if joint.kind != "fixed"]
            wrong = UnknownNameError("movable joint", rule.joint, known)
            raise ConfigError(f"{file}: joint {seen[-1]!r} mimics an unknown one: {wrong}")
        seen.append(rule.joint)
        if rule.joint in seen[:-1]:
            raise ConfigError(f"{file}: joints mimic each other in a loop: {' -> '.join(seen)}")
        if joints[rule.joint].kind == "fixed":
            raise ConfigError(f"{file}: joint {seen[-2]!r} mimics {rule.joint!r}, which is fixed")
        further = joints[rule.joint].follows
        if further is None:
            break
        rule = Follow(
            further.joint,
            rule.multiplier * further.multiplier,
            rule.multiplier * further.offset + rule.offset,
        )
    return rule


def _loop(joints: Mapping[str, Joint]) -> str:
    """Return the links of a loop, among joints that hang on no root."""
    above = {joint.child: joint.parent for joint in joints.values()}
    here, seen = next(iter(above)), list[str]()
    while here not in seen:
        seen.append(here)
        here = above[here]
    way = [*seen[seen.index(here) :], here]
    return " -> ".join(reversed(way))


def _listed(names: list[str]) -> str:
    return ", ".join(repr(name) for name in names[:5]) + (", ..." if len(names) > 5 else "")
