"""MuJoCo's model and data of a scene, stepped with Bullet's motors and contacts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from rcare_marl.body import GEAR_ERP, Body
from rcare_marl.pose import Array, Pose, Vector
from rcare_marl.scene.mjcf import START, body_name, joint_name, mjcf
from rcare_marl.scene.scene import Place, Scene

from .bullet_rows import ERP, motor_table, solve_rows, write_rows
from .caps import USUAL, cut_speeds

Ints = npt.NDArray[np.int64]
# [m] from which on a contact of what has joints is reckoned with: an arm's way in a physics step.
MARGIN = 0.001
ROUNDING = (
    0.001  # [m] of Bullet's shapes with edges: its collision margin of what is read from a URDF
)
SPARE_BONDS, SPARE_PAIRS = 8, 512  # that an episode can make, and keep apart
DEFAULT_IMPULSE = 1.0  # [N·m·s or N·s] of the motor that Bullet gives to a joint that nobody drives
TIGHT = 2.05  # time constant of joint limits, in physics steps
FACING, SIDEWAYS = slice(0, 3), (slice(3, 6), slice(6, 9))  # axes in the frame of a contact


class BodyPlaces:
    """Where a body is in MuJoCo's arrays.

    Attributes:
        links: MuJoCo's number of each link, the base first, shape [links + 1].
        positions: Place of each joint in `qpos` by Bullet's index; -1 where it is fixed, shape [links].
        dofs: The same in `qvel`.
        free: Places of a base that can move in `qpos` and `qvel`; None of another.
    """

    def __init__(self, model: Any, body: Body, root: str) -> None:
        names = [root, *(body.link_names[i] for i in range(body.link_count))]
        links = [model.body(body_name((body.name, name))).id for name in names]
        self.links = np.array(links, np.int64)
        self.positions = np.full(body.link_count, -1, np.int64)
        self.dofs = np.full(body.link_count, -1, np.int64)
        for name, joint in body.joints.items():
            found = model.joint(joint_name(body.name, name))
            self.positions[joint.index] = found.qposadr[0]
            self.dofs[joint.index] = found.dofadr[0]
        self.free: tuple[int, int] | None = None
        if body.is_movable:
            joint = model.joint(joint_name(body.name, "free"))
            self.free = int(joint.qposadr[0]), int(joint.dofadr[0])


class Simulation:
    """A scene in MuJoCo.

    Attributes:
        model: MuJoCo's model.
        data: Its data.
        places: Where the bodies are in its arrays, in the order of the world.
        motors: See `bullet_rows.motor_table`; their greatest forces are `model.dof_frictionloss`.
        qpos: Positions, as MuJoCo has them.
        qvel: Velocities.
        iterations: Sweeps of the solver in a physics step.
        strengths: Greatest force of each equality [N], shape [neq].
        caps: Greatest speed of each degree of freedom, shape [nv].
        feels: Whether it works out what joints transmit in each step.
        loads: What parents put on links in the last step: torque [N·m] about where `arms` begin, force [N],
            arms from the origins of the links to there [m], each [nbody, 3], and how links were turned,
            [nbody, 3, 3]; in the world.
        torque: What joints are pushed with in the coming step, shape [nv].
    """

    def __init__(self, scene: Scene, bodies: Sequence[Body]) -> None:
        """Build it as the scene is now.

        Raises:
            ConfigError: If MuJoCo cannot tell so many bodies apart.
        """
        files = mjcf(scene, drives=False, parts=False, spare=(SPARE_BONDS, SPARE_PAIRS))
        assets = {name: text.encode() for name, text in files.items()}
        self.model = model = mujoco.MjModel.from_xml_string(files["scene.xml"], assets)
        self.data = data = mujoco.MjData(model)
        option, bits = model.opt, mujoco.mjtDisableBit
        option.integrator = mujoco.mjtIntegrator.mjINT_EULER
        option.solver = mujoco.mjtSolver.mjSOL_PGS  # which makes `efc_AR`
        self.iterations = scene.iterations
        option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE  # so that `write_rows` finds the diagonal
        for bit in (bits.mjDSBL_ISLAND, bits.mjDSBL_ACTUATION, bits.mjDSBL_WARMSTART):
            option.disableflags |= int(bit)
        model.jnt_solref[:] = (TIGHT * scene.physics_dt, 1.0)
        is_gear = model.eq_type == int(mujoco.mjtEq.mjEQ_JOINT)
        self._shares = np.where(is_gear, GEAR_ERP, ERP)
        self.strengths = np.full(model.neq, np.inf)
        self._gain = np.zeros((1, model.nv))
        self._roots = {body.name: scene.bodies[body.name].model.root for body in bodies}
        for i, bond in enumerate(scene.bonds):
            self.strengths[model.equality(f"bond:{i}").id] = bond.force
        self.caps = np.full(model.nv, USUAL)
        self.feels = False
        nothing = np.zeros((model.nbody, 3))
        self.loads = nothing, nothing, nothing, np.zeros((model.nbody, 3, 3))
        self.places = [BodyPlaces(model, body, self._roots[body.name]) for body in bodies]
        self._bodies, self._dt = list(bodies), scene.physics_dt
        self._find_geoms(scene)
        self.motors = motor_table(model.nv)
        self._begin_motors()
        self.torque, self._pushed = data.qfrc_applied, False
        self.qpos, self.qvel = data.qpos, data.qvel
        self._joint_of = model.jnt_qposadr[model.dof_jntid].astype(np.int64)  # of free bases unused
        self.touched = np.zeros(len(bodies), np.bool_)
        mujoco.mj_resetDataKeyframe(model, data, model.key(START).id)
        self.moved()
        self.mark()

    def _find_geoms(self, scene: Scene) -> None:
        model, count = self.model, self.model.ngeom
        self._geom_body, self._geom_link = np.zeros(count, np.int64), np.zeros(count, np.int64)
        self._surfaces = np.zeros((count, 4))
        whose: dict[int, tuple[int, int, Place]] = {}
        for number, (body, places) in enumerate(zip(self._bodies, self.places, strict=True)):
            names = [self._roots[body.name], *(body.link_names[i] for i in range(body.link_count))]
            for index, (link, name) in enumerate(zip(places.links.tolist(), names, strict=True)):
                whose[link] = number, index - 1, (body.name, name)
        for geom in range(count):
            number, link, (name, link_name) = whose[int(model.geom_bodyid[geom])]
            touch = scene.bodies[name].touching[link_name]
            self._geom_body[geom], self._geom_link[geom] = number, link
            model.geom_margin[geom] = MARGIN if self._bodies[number].joints else 0.0
            self._surfaces[geom, :2] = touch.friction, touch.stiffness
            if touch.stiffness > 0:
                self._surfaces[geom, 2] = touch.damping
        self._round_off()

    def _round_off(self) -> None:
        """Give shapes with edges Bullet's margin: it lies round hulls and cylinders, and within boxes."""
        model, sorts = self.model, mujoco.mjtGeom
        boxes = model.geom_type == int(sorts.mjGEOM_BOX)
        edged = boxes | np.isin(
            model.geom_type, (int(sorts.mjGEOM_MESH), int(sorts.mjGEOM_CYLINDER))
        )
        self._surfaces[edged, 3] = ROUNDING
        thin = np.minimum(ROUNDING, 0.9 * model.geom_size[boxes].min(axis=1))
        self._surfaces[boxes, 3] = thin
        model.geom_size[boxes] -= thin[:, None]
        model.geom_margin[edged] += 2 * ROUNDING

    def _begin_motors(self) -> None:
        """Take dry friction of the joints that have any; others have the motor of Bullet's default."""
        force = self.model.dof_frictionloss
        force[:] = 0.0
        for body, places in zip(self._bodies, self.places, strict=True):
            followers = {gear.follower for gear in body.gears}
            for joint in body.joints.values():
                dry = body.friction.get(joint.index)
                usual = 0.0 if joint.index in followers else DEFAULT_IMPULSE / self._dt
                force[places.dofs[joint.index]] = usual if dry is None else dry

    def mark(self) -> None:
        """Remember the present state."""
        self._marked = [array.copy() for array in self._state()]

    def _state(self) -> list[Any]:
        """Return all arrays that an episode changes and the next must not see."""
        model, data = self.model, self.data
        return [
            *(data.qpos, data.qvel, data.eq_active, model.body_pos, model.body_quat, self.motors),
            *(
                model.dof_frictionloss,
                model.jnt_limited,
                model.jnt_range,
                self.strengths,
                self.caps,
            ),
        ]

    def rewind(self) -> None:
        """Return to the state that was marked."""
        mujoco.mj_resetData(self.model, self.data)
        for array, marked in zip(self._state(), self._marked, strict=True):
            array[:] = marked
        self.touched[:] = self._pushed = False
        self.moved()

    def moved(self) -> None:
        """Take note that something is elsewhere: what follows from positions is found when asked for."""
        self._is_placed = self._is_timed = False

    def place(self) -> None:
        """Find where all links are now."""
        if not self._is_placed:
            mujoco.mj_kinematics(self.model, self.data)
            self._is_placed = True

    def time(self) -> None:
        """Find how fast all links are now."""
        self.place()
        if not self._is_timed:
            mujoco.mj_comPos(self.model, self.data)
            mujoco.mj_comVel(self.model, self.data)
            self._is_timed = True

    def step(self) -> None:
        """Advance by one physics step."""
        model, data = self.model, self.data
        mujoco.mj_step1(model, data)
        contact, aref, count = data.contact, data.efc_aref, data.nefc
        dual = data.efc_AR.reshape(count, count)
        kinds, ids, frictions = data.efc_type, data.efc_id, contact.friction
        addresses, sizes = contact.efc_address, contact.dim
        write_rows(
            self._dt,
            self.qpos,
            self.qvel,
            self._joint_of,
            self.motors,
            self._shares,
            self._surfaces,
            self._geom_body,
            (
                *(kinds, ids, data.efc_pos, data.efc_vel, data.efc_diagA),
                *(aref, data.efc_R),
            ),
            dual,
            (contact.geom, contact.dist, addresses, sizes, frictions),
            self.touched,
        )
        mujoco.mj_fwdAcceleration(model, data)
        cut_speeds(self.qvel, data.qacc_smooth, self.caps, self._dt)
        solve_rows(
            self.iterations,
            kinds,
            ids,
            (model.dof_frictionloss, self.strengths),
            dual,
            data.efc_J.reshape(count, model.nv),
            aref,
            data.qacc_smooth,
            (addresses, sizes, frictions),
            data.efc_force,
            data.qfrc_constraint,
        )
        mujoco.mj_solveM(model, data, self._gain, data.qfrc_constraint[None])
        np.add(data.qacc_smooth, self._gain[0], out=data.qacc)
        cut_speeds(self.qvel, data.qacc, self.caps, self._dt)
        if self.feels:
            self._feel()
        mujoco.mj_Euler(model, data)
        self.torque[:] = 0.0
        if self._pushed:
            data.xfrc_applied[:] = 0.0
            self._pushed = False
        self.moved()

    def _feel(self) -> None:
        """Work out what joints transmit in this step, before anything moves."""
        model, data = self.model, self.data
        mujoco.mj_rnePostConstraint(model, data)
        wrenches = data.cfrc_int.copy()
        arms = data.subtree_com[model.body_rootid] - data.xpos  # that is where wrenches are about
        turns = data.xmat.reshape(-1, 3, 3).copy()
        self.loads = wrenches[:, :3], wrenches[:, 3:], arms, turns

    def pose(self, link: int) -> Pose:
        """Return the pose of one of MuJoCo's bodies in the world."""
        self.place()
        w, x, y, z = self.data.xquat[link].tolist()
        return Pose(tuple(self.data.xpos[link].tolist()), (x, y, z, w))

    def motion(self, link: int) -> tuple[Array, Array]:
        """Return velocity [m/s] of the origin of one of MuJoCo's bodies, and rate of turning [rad/s]."""
        self.time()
        out = np.zeros(6)
        kind = mujoco.mjtObj.mjOBJ_XBODY
        mujoco.mj_objectVelocity(self.model, self.data, kind, link, out, 0)
        return out[3:], out[:3]

    def motor_force(self, dofs: Ints) -> Array:
        """Return what the motors of degrees of freedom did in the last step [N·m or N]."""
        data = self.data
        every = np.zeros(self.model.nv)
        rows = np.flatnonzero(data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF))
        every[data.efc_id[rows]] = data.efc_force[rows]
        return np.where(dofs >= 0, every[dofs], 0.0)

    def push(self, link: int, force: Vector, point: Vector) -> None:
        """Push one of MuJoCo's bodies with `force` [N] at `point` [m] in the coming step."""
        self.place()
        row, self._pushed = self.data.xfrc_applied[link], True
        row[:3] += force
        row[3:] += np.cross(np.subtract(point, self.data.xipos[link]), force)

    def at_rest(self) -> tuple[Array, Array]:
        """Return the mass matrix, shape [nv, nv], and what gravity asks of each joint [N·m or N], [nv]."""
        data = mujoco.MjData(self.model)
        data.qpos[:] = self.data.qpos
        mujoco.mj_forward(self.model, data)
        matrix = np.zeros((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, data, matrix)
        return matrix, np.array(data.qfrc_bias)

    def limit(self, dof: int, lower: float, upper: float) -> None:
        """Change the range of a joint [rad or m]."""
        joint = self.model.dof_jntid[dof]
        self.model.jnt_limited[joint] = True
        self.model.jnt_range[joint] = lower, upper

    def set_base(self, number: int, pose: Pose) -> None:
        """Put the base of a body somewhere, at rest."""
        places, data = self.places[number], self.data
        x, y, z, w = pose.quaternion
        if places.free is None:
            self.model.body_pos[places.links[0]] = pose.position
            self.model.body_quat[places.links[0]] = (w, x, y, z)
        else:
            at, dof = places.free
            data.qpos[at : at + 7] = (*pose.position, w, x, y, z)
            data.qvel[dof : dof + 6] = 0.0
        self.moved()

    def points(self, number: int | None) -> list[tuple[Any, ...]]:
        """Return the contacts of the last step as Bullet's rows; those of one body begin with it.

        Args:
            number: Of the body in the world; all if None, and then each contact once.
        """
        if number is not None and not self.touched[number]:
            return []
        data, found = self.data, []
        contact, forces = data.contact, data.efc_force
        pairs = self._geom_body[contact.geom]
        for i in range(data.ncon) if number is None else np.flatnonzero((pairs == number).any(1)):
            row = int(contact.efc_address[i])
            if row < 0:
                continue
            own = 0 if number is not None and pairs[i, 0] == number else 1
            side = 1.0 if own == 1 else -1.0  # MuJoCo's frame looks from the first to the second
            frame = contact.frame[i]
            gap = float(contact.dist[i] - self._surfaces[contact.geom[i], 3].sum())
            normal = side * frame[FACING]
            middle = contact.pos[i]
            one, other = contact.geom[i][own], contact.geom[i][1 - own]
            drags = [float(forces[row + k]) if k < contact.dim[i] else 0.0 for k in (1, 2)]
            found.append(
                (
                    0,
                    self._bodies[self._geom_body[one]].uid,
                    self._bodies[self._geom_body[other]].uid,
                    int(self._geom_link[one]),
                    int(self._geom_link[other]),
                    tuple((middle + 0.5 * gap * normal).tolist()),
                    tuple((middle - 0.5 * gap * normal).tolist()),
                    tuple(normal.tolist()),
                    gap,
                    float(forces[row]),
                    drags[0],
                    tuple((side * frame[SIDEWAYS[0]]).tolist()),
                    drags[1],
                    tuple((side * frame[SIDEWAYS[1]]).tolist()),
                )
            )
        return found
