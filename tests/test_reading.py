"""One way to read a file: whatever is in it, a ConfigError that names it, and soon."""

from __future__ import annotations

import contextlib
import copy
import io
import json
import os
import random
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import yaml
from hostile import REFUSED, try_out

import rcare_marl
from rcare_marl import assets
from rcare_marl.agents.coaching.exercise import load_exercise
from rcare_marl.agents.people.actuation.mass_xml import read_mass_xml
from rcare_marl.agents.people.actuation.muscle_table import read_csv
from rcare_marl.agents.people.avatar import load_avatar, load_posture
from rcare_marl.agents.people.behaviour.avatar_tree import load_behaviour
from rcare_marl.agents.people.body.skeleton import JOINTS, PARENTS
from rcare_marl.agents.people.body.skin import load_body_model
from rcare_marl.agents.people.garment import load_garment
from rcare_marl.agents.people.motion.amass import load_amass
from rcare_marl.agents.people.motion.bvh import read_bvh
from rcare_marl.agents.robots.robot_config import load_robot
from rcare_marl.baselines.evaluation.protocol import read_record
from rcare_marl.baselines.policy_file import PolicyFile
from rcare_marl.baselines.training import checkpoint
from rcare_marl.baselines.training.config import load_config
from rcare_marl.config import load, parse_yaml, read_yaml
from rcare_marl.envs.devices.device_model import load_device
from rcare_marl.envs.episode import RecordedEpisode
from rcare_marl.envs.homes import load_house
from rcare_marl.errors import LONGEST, ActionError, ConfigError, RcareError
from rcare_marl.model.mesh_file import hulls
from rcare_marl.model.urdf import Model
from rcare_marl.model.urdf_reader import read as read_urdf

Reader = Callable[[Path], Any]
SEED = 27
FEW, MANY = 16, 1000  # files of each kind

BVH = """HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Chest
  {
    OFFSET 0 0.2 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 0 0.2 0
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.01
0 1 0 10 0 0 1 2 3
0 1 0 11 0 0 1 2 3
"""
MASS = """<Muscle>
<Unit name="L_Bicep" f0="1000" lm="1.0" lt="0.2" pen_angle="0" lmax="-0.1">
<Waypoint body="ArmL" p="0.35 1.4 -0.02"/><Waypoint body="ForeArmL" p="0.5 1.4 -0.02"/>
</Unit></Muscle>"""
URDF = """<robot name="r"><link name="a"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><box size="1 1 1"/></geometry></collision></link>
<link name="b"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="10" velocity="1"/></joint></robot>"""
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 2 3 4\n"
DAE = """<COLLADA><library_geometries><geometry id="g"><mesh><source id="p">
<float_array>0 0 0 1 0 0 0 1 0 0 0 1</float_array></source><vertices id="v">
<input semantic="POSITION" source="#p"/></vertices><triangles><input semantic="VERTEX" source="#v"
offset="0"/><p>0 1 2 0 1 3</p></triangles></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene><node><instance_geometry url="#g"/></node></visual_scene>
</library_visual_scenes></COLLADA>"""


def npz(**arrays: Any) -> bytes:
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def saved(tmp_path: Path) -> bytes:
    checkpoint.save(tmp_path / "ok.pt", {"a": torch.zeros(3), "n": 1, "x": np.arange(3.0)})
    return (tmp_path / "ok.pt").read_bytes()


def shipped(kind: str, name: str) -> bytes:
    return assets.find(kind, name).read_bytes()


MOTION = npz(poses=np.zeros((4, 165)), trans=np.zeros((4, 3)), mocap_frame_rate=np.array(30.0))
BASELINES = Path(rcare_marl.__file__).parent / "baselines"
TRAINED, CONFIGS = BASELINES / "trained" / "feeding.npz", BASELINES / "configs"
GARMENT = assets.names("garments")[0]
MODEL = assets.ROOT / "robots" / "kinova_gen3" / "model.yaml"
RECORD = json.dumps({"format": 1, "plan": {}, "policies": [], "summary": {"a": [1.5, 2]}}).encode()
# Both as small as they may be, so that many are read soon; SMPL-X itself has one size alone.
BODY = npz(
    vertices=np.eye(4, 3),
    faces=np.array([[0, 1, 2]]),
    joints=np.zeros((len(JOINTS), 3)),
    weight_joints=np.zeros((4, 4), np.uint8),
    weights=np.full((4, 4), 0.25),
    colors=np.zeros((4, 3), np.uint8),
    mouth=np.zeros(3),
    meta_json=np.array("{}"),
)
SMPLX = npz(
    v_template=np.zeros((9, 3)),
    f=np.zeros((3, 3), np.int64),
    weights=np.zeros((9, len(JOINTS))),
    J_regressor=np.zeros((len(JOINTS), 9)),
    kintree_table=np.array([PARENTS, range(len(JOINTS))]),
)
CENTRES = np.zeros((len(JOINTS), 3))

# What reads a kind of file, its ending, and a good one.
READERS: dict[str, tuple[Reader, str, Callable[[Path], bytes]]] = {
    "robot": (load_robot, ".yaml", lambda _: shipped("robots", "kinova_gen3")),
    "avatar": (load_avatar, ".yaml", lambda _: shipped("avatars", "kim")),
    "posture": (load_posture, ".yaml", lambda _: shipped("postures", "wheelchair")),
    "device": (load_device, ".yaml", lambda _: shipped("devices", "cup")),
    "behaviour": (load_behaviour, ".yaml", lambda _: shipped("behaviours", "kim")),
    "garment": (load_garment, ".yaml", lambda _: shipped("garments", GARMENT)),
    "exercise": (load_exercise, ".yaml", lambda _: shipped("exercises", "upper_lift")),
    "training": (load_config, ".yaml", lambda _: (CONFIGS / "feeding.yaml").read_bytes()),
    "model": (lambda path: load(Model, path), ".yaml", lambda _: MODEL.read_bytes()),
    "home": (load_house, ".yaml", lambda _: shipped("homes", "house_07")),
    "motion": (load_amass, ".npz", lambda _: MOTION),
    "body": (load_body_model, ".npz", lambda _: BODY),
    "smplx": (load_body_model, ".npz", lambda _: SMPLX),
    "policy": (PolicyFile.read, ".npz", lambda _: TRAINED.read_bytes()),
    "episode": (RecordedEpisode.read, ".npz", lambda _: TRAINED.read_bytes()),
    "bvh": (read_bvh, ".bvh", lambda _: BVH.encode()),
    "mass": (
        lambda path: read_mass_xml(path, skeleton=None, default=CENTRES),
        ".xml",
        lambda _: MASS.encode(),
    ),
    "table": (lambda path: read_csv(path, ("a", "b")), ".csv", lambda _: b"a,b\n1,2\n"),
    "urdf": (read_urdf, ".urdf", lambda _: URDF.encode()),
    "obj": (hulls, ".obj", lambda _: OBJ.encode()),
    "stl": (
        hulls,
        ".stl",
        lambda _: b"solid\nfacet normal 0 0 1\nouter loop\n" + b"vertex 0 0 0\n",
    ),
    "dae": (hulls, ".dae", lambda _: DAE.encode()),
    "record": (read_record, ".json", lambda _: RECORD),
    "checkpoint": (checkpoint.load, ".pt", saved),
}


def check(read: Reader, file: Path, *, must_fail: bool = False) -> None:
    """Read a file; it is taken, or refused soon and in a few words."""
    assert try_out(lambda: read(file), file) is REFUSED or not must_fail, file


def mutated(rng: random.Random, data: bytes) -> bytes:
    """Return what a fault of a disk, a program or an enemy makes of a file."""
    tokens: tuple[bytes, ...] = (
        b"-1",
        b"1e308",
        b"nan",
        b"9" * 5000,
        b"&a",
        b"*a",
        b"[" * 500,
        b"2020-99-99",
        b"!!int x",
    )
    tokens += (
        b"!!python/object:os.system",
        b"<a>" * 500,
        b"\x00",
        b"\xff\xfe",
        b"{}",
        b"''",
        b"true",
    )
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8))):
        at = rng.randrange(len(out) + 1)
        kind = rng.randrange(6)
        if kind == 0 and out:
            out[at % len(out)] = rng.randrange(256)
        elif kind == 1:
            out[at : at + rng.randrange(40)] = b""
        elif kind == 2:
            out[at : at + rng.randrange(8)] = rng.choice(tokens)
        elif kind == 3:
            out[at:at] = out[at : at + rng.randrange(200)]
        elif kind == 4:
            del out[at:]
        else:  # a word is another one
            words = bytes(out).split()
            if words:
                out = bytearray(
                    bytes(out).replace(rng.choice(words), rng.choice((*tokens, *words)), 1)
                )
    return bytes(out)


ODD: tuple[Any, ...] = (
    None,
    True,
    -1,
    0,
    1e308,
    -1e-308,
    10**400,
    2**70,
    "",
    "x",
    "é" * 300,
    [],
    {},
)
ODD += (
    [[]],
    {"a": {}},
    [1, "a"],
    {1: 2},
    [None],
    1.5,
    "nan",
    ".inf",
    "house_07",
    [1, 2, 3],
    [0, 0, 0],
)
ARRAYS: tuple[Any, ...] = (
    *(np.zeros(shape) for shape in ((), (0,), (3,), (4, 165), (2, 3, 4), (0, 165))),
    *(np.full(3, value) for value in (np.nan, 1e308, -np.inf, 1j, True, "a", -1, 2**62)),
    np.array([{}], object),
    np.zeros(3, "datetime64[s]"),
    np.zeros(3, [("a", "f8")]),
    np.frombuffer(b"{", np.uint8),
    np.frombuffer(b'{"version": 1}', np.uint8),
    np.frombuffer(b"[" * 9999, np.uint8),
)


def twisted(rng: random.Random, value: Any) -> Any:
    """Return nested data in which something somewhere is something else, is missing or too much."""
    if isinstance(value, dict | list) and value and rng.random() < 0.85:
        keys = list(value) if isinstance(value, dict) else list(range(len(value)))
        key = rng.choice(keys)
        out = copy.copy(value)
        way = rng.random()
        if way < 0.1:
            del out[key]
        elif way < 0.2:
            more = rng.choice(("odd", key, 5))
            out = [*out, out[key]] if isinstance(out, list) else {**out, more: out[key]}
        else:
            out[key] = twisted(rng, value[key])
        return out
    return rng.choice(ODD)


def restated(rng: random.Random, ending: str, whole: bytes) -> bytes | None:
    """Return a file that its format allows, with something odd in it; None for other formats."""
    if ending == ".yaml":
        return yaml.safe_dump(twisted(rng, yaml.safe_load(whole))).encode()
    if ending == ".json":
        return json.dumps(twisted(rng, json.loads(whole))).encode()
    if ending == ".npz":
        with np.load(io.BytesIO(whole)) as data:
            arrays: dict[str, Any] = dict(data)
        name = rng.choice(list(arrays))
        was = arrays[name]
        own = [was[:-1], was.T, -was, was.astype(str), was[None], was * 0] if was.ndim else []
        arrays[name] = rng.choice((*ARRAYS, *own))
        if "about" in arrays and rng.random() < 0.5:
            about = json.loads(dict(np.load(io.BytesIO(whole)))["about"].tobytes())
            text = json.dumps(twisted(rng, about)).encode()
            arrays = {**arrays, name: was, "about": np.frombuffer(text, np.uint8)}
        return npz(**arrays)
    if ending == ".pt":
        stream = io.BytesIO()
        torch.save(twisted(rng, torch.load(io.BytesIO(whole), weights_only=True)), stream)
        return stream.getvalue()
    return None


@pytest.mark.parametrize(
    "count", [pytest.param(FEW, id="few"), pytest.param(MANY, id="many", marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("kind", READERS)
@pytest.mark.filterwarnings("ignore")
def test_a_damaged_file_is_taken_or_refused_in_words(kind: str, count: int, tmp_path: Path) -> None:
    read, ending, good = READERS[kind]
    whole = good(tmp_path)
    first = tmp_path / f"first{ending}"
    first.write_bytes(whole)
    with contextlib.suppress(RcareError):
        read(first)  # what it needs is imported
    for number in range(count):
        rng = random.Random(f"{SEED} {kind} {number}")
        file = tmp_path / f"{number}{ending}"
        data = restated(rng, ending, whole) if number % 2 else None
        file.write_bytes(mutated(rng, whole) if data is None else data)
        try:
            check(read, file)
        except BaseException:
            print(f"{kind}, number {number} of seed {SEED}")
            raise
        file.unlink()


@pytest.mark.parametrize("kind", sorted(set(READERS) - {"smplx", "episode", "mass", "stl"}))
def test_a_good_file_is_taken(kind: str, tmp_path: Path) -> None:
    read, ending, good = READERS[kind]
    file = tmp_path / f"good{ending}"
    file.write_bytes(good(tmp_path))
    read(file)


@pytest.mark.parametrize("kind", READERS)
def test_what_is_no_regular_file_is_refused_at_once(kind: str, tmp_path: Path) -> None:
    read, ending, _ = READERS[kind]
    pipe, zero, folder = (tmp_path / f"{name}{ending}" for name in ("pipe", "zero", "folder"))
    os.mkfifo(pipe)
    zero.symlink_to("/dev/zero")
    folder.mkdir()
    empty = tmp_path / f"empty{ending}"
    empty.write_bytes(b"")
    for file in (pipe, zero, folder, tmp_path / f"missing{ending}", empty):
        check(read, file, must_fail=True)


@pytest.mark.parametrize(
    "text",
    [
        "z: 2020-99-99",
        f"z: {'9' * 6000}",
        "2001-13-45: 1",
        "z: !!int x",
        "z: !!float x",
        "z: !!bool x",
        "z: !!set [1]",
        "z: !!timestamp x",
        "z: &a [*a]",
        "[1]: 2",
        "[" * 5000,
        "z: " + "{a: " * 900,
        "a: &a [1,1,1,1,1,1,1,1,1,1]\n"
        + "\n".join(
            f"{'bcdefghi'[i]}: &{'bcdefghi'[i]} [{','.join(['*' + 'abcdefgh'[i]] * 10)}]"
            for i in range(8)
        ),
    ],
)
def test_yaml_of_every_sort_is_refused_in_words(text: str, tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    file.write_text(text)
    check(read_yaml, file, must_fail=True)
    with pytest.raises(ConfigError, match="not valid YAML"):
        parse_yaml(text, "here")


def test_archives_that_lie_are_refused(tmp_path: Path) -> None:
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)}
    )
    bare = io.BytesIO()
    np.save(bare, np.zeros(3))
    packed, twice = io.BytesIO(), io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for name in ("poses", "trans", "mocap_frame_rate"):
            archive.writestr(f"{name}.npy", header.getvalue())
    with pytest.warns(UserWarning, match="Duplicate"), zipfile.ZipFile(twice, "w") as archive:
        archive.writestr("poses.npy", bare.getvalue())
        archive.writestr("poses.npy", bare.getvalue())
    encrypted, unknown = bytearray(MOTION), bytearray(MOTION)
    for at in (MOTION.index(b"PK\x01\x02"), 0):
        encrypted[at + (8 if at else 6)] |= 1
        unknown[at + (10 if at else 8)] = 99
    lies: tuple[bytes, ...] = (packed.getvalue(), twice.getvalue(), bare.getvalue())
    lies += bytes(encrypted), bytes(unknown), npz(poses=np.array([{}], object))
    for wrong in ({"poses": np.full((4, 165), 1e308)}, {"trans": np.full((4, 3), 1j)}):
        arrays: dict[str, Any] = {"poses": np.zeros((4, 165)), "trans": np.zeros((4, 3))}
        lies += (npz(**{**arrays, **wrong}, mocap_frame_rate=30.0),)
    for rate in (1e308, 1e-308, np.nan, "a", -1):
        lies += (npz(poses=np.zeros((4, 165)), trans=np.zeros((4, 3)), mocap_frame_rate=rate),)
    for number, data in enumerate(lies):
        file = tmp_path / f"{number}.npz"
        file.write_bytes(data)
        for kind in ("motion", "body", "policy", "episode"):
            check(READERS[kind][0], file, must_fail=True)


@pytest.mark.parametrize(
    "wrong", [{"format": 1}, {"format": [1]}, {"format": 1, "config": 3, "state": {}}]
)
def test_a_checkpoint_of_another_shape_is_refused(wrong: dict[str, Any], tmp_path: Path) -> None:
    torch.save(wrong, tmp_path / "a.pt")
    check(checkpoint.load, tmp_path / "a.pt", must_fail=True)


def test_an_error_is_short_whatever_was_given() -> None:
    deep: Any = []
    for _ in range(3000):
        deep = [deep]
    wide: Any = 1
    for _ in range(25):
        wide = [wide] * 10
    for value in (deep, wide, "x" * 10**6, 10**5000, {"a": wide}):
        with pytest.raises(RcareError) as told:
            rcare_marl.make("feeding", options={"reward": value})
        assert len(str(told.value)) <= LONGEST


@pytest.mark.parametrize(
    "wrong",
    [
        {"home": 5},
        {"home": "house_07", "room": 5},
        {"home": "house_07", "level": "1"},
        {"policies": {5: "still"}},
        {"policies": {"recipient": lambda env, role: None}},
        {"policies": {"recipient": lambda env, role: 42}},
        {"policies": {"recipient": 1j}},
        {"physics_dt": 1e-9},
        {"physics_dt": 10**400},
        {"physics_dt": "0.01"},
        {"physics_dt": 1j},
        {"physics_dt": True},
        {"render_mode": 5},
        {"engine": []},
        {"robot": 5},
        {"robot": {"posture_noise": 10**400}},
        {"robot": {"posture_noise": 1e308}},
        {"robot": {"model": {}}},
        {"recipient": {"model": 3.5}},
        {"recipient": {"movable": 5}},
        {"recipient": {"tissue": ["left_arm", "left_arm"]}},
        {"recipient": "population:test:99999999999999999999"},
        {"recipient": "\x00.yaml"},
    ],
)
def test_an_argument_of_another_type_is_refused_by_name(wrong: dict[str, Any]) -> None:
    with pytest.raises(RcareError) as told:
        rcare_marl.make("feeding", **wrong)
    assert len(str(told.value)) <= LONGEST


def test_a_task_that_is_no_name_is_refused() -> None:
    odd: tuple[Any, ...] = (None, 5, [], {}, b"feeding")
    for task in odd:
        with pytest.raises(RcareError, match="no task named"):
            rcare_marl.make(task)


def test_calls_with_other_types_are_refused_by_name() -> None:
    policies = {"recipient": "cooperative"}
    with rcare_marl.make("feeding", policies=policies) as env:
        with pytest.raises(ConfigError, match="options must be"):
            env.reset(options=5)
        env.reset(seed=0)
        odd: Any
        for odd in ([], {}, None, 5, 1j):
            with pytest.raises(RcareError, match="role"):
                env.observe(odd)
            with pytest.raises(RcareError, match="role"):
                env.describe(odd)
        size = env.action_space("robot").shape[0]
        words: Any = (
            ["0.1"] * size,
            [1j] * size,
            np.zeros(size, "datetime64[s]"),
            [10**400] * size,
        )
        for odd in (*words, [None] * size, "move", None, [[0.0] * size], {}):
            with pytest.raises(ActionError, match="robot"):
                env.step({"robot": odd})
