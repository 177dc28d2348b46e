"""URDF files that cannot be used are refused with words that say what is wrong, and where."""

from __future__ import annotations

from pathlib import Path

import pytest
from urdf_files import BODY, LIMIT, arm, hull_file, joint, link, urdf
from urdf_files import cache as cache
from urdf_files import own_cache as own_cache  # both for pytest, which uses what it finds here

from rcare_marl.errors import ConfigError, UnknownNameError
from rcare_marl.model.urdf import write
from rcare_marl.model.urdf_reader import check_driven, read

BROKEN = {
    "no links": ("", "has no links"),
    "number": (
        arm('<limit lower="-1" upper="a" effort="5" velocity="2"/>'),
        r"line 5, joint 'j' > limit: upper must be a finite number, got 'a'",
    ),
    "infinite": (link("a", '<inertial><mass value="nan"/></inertial>'), "value must be a finite"),
    "few numbers": (arm('<origin xyz="0 1"/>' + LIMIT), "xyz must be 3 finite numbers.*got '0 1'"),
    "no name": ("<link/>", r'link: it needs name="..."'),
    "two links": (link("a") + link("a"), "link of this name already, on line 3"),
    "two joints": (arm() + link("c") + joint("j", "a", "c"), "joint of this name already"),
    "two roots": (arm() + link("c"), "2 links hang on no joint: 'a', 'c'"),
    "two parents": (
        arm() + link("c") + joint("k", "a", "c") + joint("l", "b", "c"),
        "'c' hangs on two joints, 'k' and 'l'",
    ),
    "loop": (
        link("o") + link("a") + link("b") + joint("j", "a", "b") + joint("k", "b", "a"),
        "make a loop: [ab] -> [ab] -> [ab]",
    ),
    "loop alone": (
        link("a") + link("b") + joint("j", "a", "b") + joint("k", "b", "a"),
        "make a loop: ",
    ),
    "unknown link": (link("base") + joint("j", "bsae", "base"), "bsae.*Did you mean 'base'"),
    "no child": (
        link("a") + '<joint name="j" type="fixed"><parent link="a"/></joint>',
        "joint 'j': it needs a <child>",
    ),
    "floating": (
        arm("", "floating"),
        "one of fixed, revolute, continuous, prismatic, got 'floating'",
    ),
    "planar": (arm("", "planar"), "got 'planar'; its base is placed by a mount"),
    "crossed": (
        arm('<limit lower="1" upper="-1" effort="1" velocity="1"/>'),
        "lower 1 exceeds upper -1",
    ),
    "no limit": (arm("", "prismatic"), "a prismatic joint needs <limit"),
    "no range": (
        arm('<limit effort="1" velocity="1"/>'),
        'needs lower and upper .or make .*"continuous"',
    ),
    "effort": (
        arm('<limit lower="0" upper="1" effort="-1" velocity="1"/>'),
        "effort cannot be negative",
    ),
    "axis": (arm('<axis xyz="0 0 0"/>' + LIMIT), "axis: an axis cannot have length 0"),
    "mass": (link("a", '<inertial><mass value="-2"/></inertial>'), "cannot be negative, got -2"),
    "no mass": (link("a", "<inertial/>"), "inertial: it needs a <mass>"),
    "shape": (
        link("a", "<collision><geometry><cone/></geometry></collision>"),
        "expected one of <box>, .*got <cone>",
    ),
    "size": (
        link("a", '<collision><geometry><box size="1 0 1"/></geometry></collision>'),
        "size must be positive, got 1 0 1",
    ),
    "colour": (
        link(
            "a",
            '<visual><geometry><sphere radius="1"/></geometry><material name="m">'
            '<color rgba="255 0 0 1"/></material></visual>',
        ),
        "rgba must lie between 0 and 1",
    ),
    "mimic": (arm(LIMIT + '<mimic joint="jj"/>'), "'j' mimics an unknown one.*Did you mean 'j'"),
    "mimic loop": (arm(LIMIT + '<mimic joint="j"/>'), "in a loop: j -> j"),
    "mimic fixed": (
        arm(LIMIT + '<mimic joint="k"/>') + link("c") + joint("k", "a", "c", "", "fixed"),
        "'j' mimics 'k', which is fixed",
    ),
    "format": (
        link("a", '<visual><geometry><mesh filename="x.blend"/></geometry></visual>'),
        "must be one of .obj, .stl, .dae",
    ),
    "scale": (
        link(
            "a",
            '<visual><geometry><mesh filename="meshes/part.obj" scale="1 0 1"/></geometry>'
            "</visual>",
        ),
        "no part of scale may be 0",
    ),
    "xacro": ('<xacro:include filename="b.xacro"/>', "not expanded yet.*xacrodoc"),
    "xacro value": (
        link("a", '<visual><origin xyz="${x} 0 0"/></visual>'),
        "line 3: '.{x} 0 0' says",
    ),
}


@pytest.mark.parametrize("fault", BROKEN)
def test_each_fault_is_named_with_its_place(tmp_path: Path, fault: str) -> None:
    hull_file(tmp_path)
    body, message = BROKEN[fault]
    file = urdf(tmp_path, body)
    with pytest.raises(ConfigError, match=message) as caught:
        read(file)
    assert str(file) in str(caught.value)


def test_a_missing_file_names_its_neighbours(tmp_path: Path) -> None:
    urdf(tmp_path, arm(), "fetch.urdf")
    with pytest.raises(ConfigError, match="no URDF at .*Did you mean 'fetch.urdf'"):
        read(tmp_path / "fetsh.urdf")
    with pytest.raises(ConfigError, match="is a folder, not a URDF. URDFs in it: fetch.urdf"):
        read(tmp_path)
    with pytest.raises(ConfigError, match="There is no folder"):
        read(tmp_path / "nowhere" / "fetch.urdf")


def test_what_is_no_urdf_is_said_to_be_none(tmp_path: Path) -> None:
    file = tmp_path / "x.urdf"
    file.write_text("<robot>\n<link name='a'>\n</robot>")
    with pytest.raises(ConfigError, match="x.urdf is not XML: mismatched tag, line 3"):
        read(file)
    file.write_text("<mujoco/>")
    with pytest.raises(ConfigError, match="outermost element is <mujoco>, expected <robot>"):
        read(file)


def test_all_missing_meshes_are_listed_with_where_they_were_looked_for(tmp_path: Path) -> None:
    names = [
        "a.stl",
        "package://theirs/b.dae",
        "https://c.org/c.obj",
        *(f"{i}.obj" for i in range(4)),
    ]
    shown = "".join(
        f'<visual><geometry><mesh filename="{name}"/></geometry></visual>' for name in names
    )
    with pytest.raises(ConfigError) as caught:
        read(urdf(tmp_path, link("a", shown)))
    text = str(caught.value)
    assert "a.stl (looked in" in text and "package folder 'theirs' above" in text
    assert "https:// is not fetched" in text and "and 2 more" in text and "ROS_PACKAGE_PATH" in text


def test_more_joints_than_bullet_handles_are_refused(tmp_path: Path) -> None:
    body = link("l0") + "".join(
        link(f"l{i}") + joint(f"j{i}", f"l{i - 1}", f"l{i}") for i in range(1, 129)
    )
    with pytest.raises(ConfigError, match="128 movable joints; Bullet handles at most 127"):
        read(urdf(tmp_path, body))


def test_a_broken_mesh_is_named(tmp_path: Path) -> None:
    (tmp_path / "x.obj").write_text("nothing here\n")
    solid = '<collision><geometry><mesh filename="x.obj"/></geometry></collision>'
    model = read(urdf(tmp_path, link("a", BODY + solid)))
    with pytest.raises(ConfigError, match="x.obj has no surface"):
        write(model)


def test_joints_that_the_physics_could_not_move_are_all_listed(tmp_path: Path) -> None:
    body = link("a") + link("b") + link("c") + link("d", "") + link("e")
    body += joint("weak", "a", "b", '<limit lower="0" upper="1" velocity="1"/>')
    body += joint("still", "a", "c", '<limit lower="0" upper="0" effort="1" velocity="1"/>')
    body += joint("light", "b", "d") + joint("wheel", "a", "e", "", "continuous")
    body += link("f") + joint("weld", "a", "f", "", "fixed") + link("g") + joint("good", "a", "g")
    model = read(urdf(tmp_path, body))
    with pytest.raises(ConfigError) as caught:
        check_driven(model, ["weak", "still", "light", "wheel", "weld", "good"])
    text = str(caught.value)
    for part in (
        "'weak' has no effort: give <limit effort",
        "'still' has no travel",
        "'light' moves only links without mass",
        "'wheel' has no effort and no velocity",
        "'weld' is fixed",
    ):
        assert part in text
    assert "'good'" not in text
    check_driven(model, ["good"])
    with pytest.raises(UnknownNameError, match="Did you mean 'weak'"):
        check_driven(model, ["waek"])
