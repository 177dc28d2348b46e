"""Assistive devices as furniture: they stand at rest; `envs.devices` has those that work."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from rcare_marl.model.shape import Shape, Triple
from rcare_marl.model.urdf import Joint, Link, Model, joint_pose

from ...devices import Frame, HospitalBed, ManualWheelchair, TransferBench
from ...rectangle import Rectangle
from ..piece import Piece, Setting, Zone, maker

_WHEELCHAIR_BACK, _WHEELCHAIR_FRONT = 0.47, 0.6  # from the origin of the chair [m]
_WHEELCHAIR_BACKREST = 0.5  # above the seat [m]
_BENCH_BACK, _BENCH_FRONT = 0.29, 0.19  # from the origin of the bench [m]
# [m] by which what is round may be angular: they are seen from farther away than where they work.
_ERROR = 0.006


def at_rest(model: Model, shift: Triple, positions: Mapping[str, float]) -> Model:
    """Return a device as a thing that nothing moves, drawn by fewer triangles, in colours of its own.

    Args:
        model: The device.
        shift: Where its origin is in the piece [m].
        positions: Where joints stand [rad or m]; zero if absent.
    """

    def own(shape: Shape) -> Shape:
        material = f"{model.name}_{shape.material}"
        return dataclasses.replace(shape, material=material, segments=0, steps=0).coarse(_ERROR)

    links = {"piece": Link()} | {
        name: dataclasses.replace(link, visual=tuple(own(shape) for shape in link.visual))
        for name, link in model.links.items()
    }
    joints = {"stands": Joint(kind="fixed", parent="piece", child=model.root, at=shift)}
    for name, joint in model.joints.items():
        pose = joint_pose(joint, positions.get(name, 0.0))
        x, y, z = pose.position
        # Frames of links are parallel: only slides may stand elsewhere than at zero.
        joints[name] = Joint(kind="fixed", parent=joint.parent, child=joint.child, at=(x, y, z))
    materials = {f"{model.name}_{name}": colour for name, colour in model.materials.items()}
    return Model(
        name=model.name, source=model.source, links=links, joints=joints, materials=materials
    )


def _moved(frames: Mapping[str, Frame], by: Triple) -> dict[str, Frame]:
    """Return frames moved by `by` [m]."""
    out = {}
    for name, frame in frames.items():
        x, y, z = (a + b for a, b in zip(frame.position, by, strict=True))
        out[name] = dataclasses.replace(frame, position=(x, y, z))
    return out


@maker("hospital_bed")
def make_hospital_bed(setting: Setting) -> Piece:
    """Make a hospital bed, its head against the wall, its platform where the level wants mattresses."""
    bed, rules = HospitalBed(), setting.rules
    f = bed.model.figure
    lowest, highest = (f(end) + f("mattress_thickness") for end in ("low", "high"))
    top = min(max(rules.figure("bed_height"), lowest), highest)
    rest = top - lowest
    length, half = f("mattress_length") + 2 * f("end"), 0.5 * f("mattress_width") + 0.05
    space = rules.figure("bed_side_space")
    frames = {
        name: frame if name.startswith("side") else _moved({name: frame}, (0.0, 0.0, rest))[name]
        for name, frame in bed.frames.items()
    }
    return Piece(
        kind="hospital_bed",
        model=at_rest(bed.model, (0.0, 0.0, 0.0), {"height": rest}),
        footprint=Rectangle(0.0, -half, length, half),
        height=max(f("board_height"), top + 0.3),
        zones=(
            Zone(Rectangle(0.5, half, length, half + space)),
            Zone(Rectangle(0.5, -half - space, length, -half)),
        ),
        frames=frames,
        measures={"bed_height": top, "bed_side_space": space},
    )


@maker("manual_wheelchair")
def make_manual_wheelchair(setting: Setting) -> Piece:
    """Make a wheelchair that is parked with its back to the wall."""
    chair = ManualWheelchair(headrest=False)
    shift, half = (_WHEELCHAIR_BACK, 0.0, 0.0), 0.5 * chair.model.figure("width")
    front = _WHEELCHAIR_BACK + _WHEELCHAIR_FRONT
    frames = {key: frame for key, frame in chair.frames.items() if key != "headrest"}
    return Piece(
        kind="manual_wheelchair",
        model=at_rest(chair.model, shift, {}),
        footprint=Rectangle(0.0, -half, front, half),
        height=chair.frame("seat").position[2] + _WHEELCHAIR_BACKREST + 0.02,
        frames=_moved(frames, shift),
    )


@maker("transfer_bench")
def make_transfer_bench(setting: Setting, *, seat_height: float = 0.48) -> Piece:
    """Make a transfer bench with its backrest to the wall and its seat `seat_height` [m] high.

    The seat is at the right; a bathtub's rim goes below the left.
    """
    bench = TransferBench(seat_height=seat_height)
    f = bench.model.figure
    out = seat_height - f("seat_low")
    shift, half = (_BENCH_BACK, 0.0, out), 0.5 * f("length") + 0.015
    positions = dict.fromkeys(bench.controls, out)
    return Piece(
        kind="transfer_bench",
        model=at_rest(bench.model, shift, positions),
        footprint=Rectangle(0.0, -half, _BENCH_BACK + _BENCH_FRONT, half),
        height=seat_height + f("backrest_height") + 0.06,
        frames=_moved(bench.frames, shift),
        measures={"bath_seat_height": seat_height},
    )
