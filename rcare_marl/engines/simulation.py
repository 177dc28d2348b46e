"""MuJoCo's model and data of a scene, stepped with Bullet's motors and contacts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from rcare_marl.body import GEAR_ERP, Body
from rcare_marl.pose import Array, Pose, Vector
from rcare_marl.scene.mjcf import START, body_name, joint_name, mjcf
from rcare_marl.scene.scene import Place, Scene

from .bullet_rows import ERP, motor_table, physics_step, touch
from .caps import USUAL
from .gaps import Gaps
from .manifolds import Manifolds
from .native import Ints, addresses
from .neighbours import Neighbours
from .row_order import BOND, GEAR, MOTOR, TIE, Row

# [m] from which on a contact of what has joints is reckoned with: an arm's way in a physics step.
MARGIN = 0.001
# [m] of Bullet's shapes with edges: its collision margin of what is read from a URDF.
ROUNDING = 0.001
SPARE_BONDS = 8  # that an episode can make
DEFAULT_IMPULSE = 1.0  # [N·m·s or N·s] of the motor that Bullet gives to a joint that nobody drives
TIGHT = 2.05  # time constant of joint limits, in physics steps
NOTHING = np.zeros(0, np.int64)
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
        motors: See `bullet_rows.motor_table`.
        motor_limits: Their greatest forces [N·m or N], shape [nv]; MuJoCo's dry friction.
        qpos: Positions, as MuJoCo has them.
        qvel: Velocities.
        strengths: Greatest force of each equality [N], shape [neq].
        caps: Greatest speed of each degree of freedom, shape [nv].
        feels: Whether it works out what joints transmit in each step, shape [1].
        torque: What joints are pushed with in the coming step, shape [nv].
        motor_forces: What the motor of each degree of freedom did in the last step [N·m or N], shape [nv].
        touched: Of each body, whether it touched something in the last step.
        surfaces: Friction, stiffness, damping, rounding and whether it is a box, of each geom, shape
            [ngeom, 5].
        ranks: Place in Bullet's order of each motor, end of a joint and equality, see `order`; and which
            equalities are gears.
        neighbours: Who meets, and what of it is near.
        manifolds: The points in which shapes touched before.
        compiled: What `physics_step` takes.
    """

    def __init__(self, scene: Scene, bodies: Sequence[Body]) -> None:
        """Build it as the scene is now.

        Raises:
            ConfigError: If MuJoCo cannot tell so many bodies apart.
        """
        files = mjcf(scene, drives=False, parts=False, spare=SPARE_BONDS, as_bullet=True)
        assets = {name: text.encode() for name, text in files.items()}
        self.model = model = mujoco.MjModel.from_xml_string(files["scene.xml"], assets)
        self.data = data = mujoco.MjData(model)
        option, bits = model.opt, mujoco.mjtDisableBit
        option.integrator = mujoco.mjtIntegrator.mjINT_EULER
        option.solver = mujoco.mjtSolver.mjSOL_NEWTON  # which leaves more undone before it solves
        self._sweeps = np.array([scene.iterations])
        option.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
        for name in ("ISLAND", "ACTUATION", "WARMSTART", "MULTICCD"):  # Bullet finds one point, too
            option.disableflags |= int(getattr(bits, f"mjDSBL_{name}"))
        model.jnt_solref[:] = (TIGHT * scene.physics_dt, 1.0)
        is_gear = model.eq_type == int(mujoco.mjtEq.mjEQ_JOINT)
        self._shares = np.where(is_gear, GEAR_ERP * ERP, ERP)
        self.strengths = np.full(model.neq, np.inf)
        self._roots = {body.name: scene.bodies[body.name].model.root for body in bodies}
        for i, bond in enumerate(scene.bonds):
            self.strengths[model.equality(f"bond:{i}").id] = bond.force
        self.caps = np.full(model.nv, USUAL)
        self.ranks = *(np.zeros(n, np.int64) for n in (model.nv, model.njnt, model.neq)), is_gear
        self.feels = np.zeros(1, np.bool_)
        seen = data.subtree_com, data.xpos, data.xmat
        self._felt = self.feels, seen, tuple(array.copy() for array in seen)
        self.places = [BodyPlaces(model, body, self._roots[body.name]) for body in bodies]
        self._bodies, self._dt = list(bodies), scene.physics_dt
        self._find_geoms(scene)
        self.motors, self.motor_limits = motor_table(model.nv), model.dof_frictionloss
        self._begin_motors()
        self.torque, self._pushed = data.qfrc_applied, False
        self.qpos, self.qvel = data.qpos, data.qvel
        self._spots, self._turns = data.xpos, data.xquat
        self._joint_of = model.jnt_qposadr[model.dof_jntid].astype(np.int64)  # of free bases unused
        self.touched = np.zeros(len(bodies), np.bool_)
        self.motor_forces = np.zeros(model.nv)
        self.manifolds = Manifolds(model, self.surfaces[:, 3].copy(), self._frames())
        links = [places.links for places in self.places]
        self.neighbours = Neighbours(model, data, links, self.manifolds.loose)
        self.compiled = self._compiled()
        self._gaps = Gaps(model, data, self.surfaces[:, 3].copy())
        self._compared: dict[Any, tuple[Ints, Ints, Ints]] = {}
        mujoco.mj_resetDataKeyframe(model, data, model.key(START).id)
        self.moved()
        self.mark()

    def _find_geoms(self, scene: Scene) -> None:
        model, count = self.model, self.model.ngeom
        self._geom_body, self._geom_link = np.zeros(count, np.int64), np.zeros(count, np.int64)
        self.surfaces = np.zeros((count, 5))
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
            self.surfaces[geom, :2] = touch.friction, touch.stiffness
            if touch.stiffness > 0:
                self.surfaces[geom, 2] = touch.damping
        self._round_off()
        pairs = list(zip(self._geom_body.tolist(), self._geom_link.tolist(), strict=True))
        keys = {*pairs, *((number, None) for number in range(len(self._bodies)))}
        self._geoms_of = {
            (number, link): np.array(
                [i for i, (n, at) in enumerate(pairs) if n == number and link in (None, at)],
                np.int64,
            )
            for number, link in keys
        }

    def _round_off(self) -> None:
        """Give shapes with edges Bullet's margin: it lies round hulls and cylinders, and within boxes."""
        model, sorts = self.model, mujoco.mjtGeom
        boxes = model.geom_type == int(sorts.mjGEOM_BOX)
        others = (int(sorts.mjGEOM_MESH), int(sorts.mjGEOM_CYLINDER))
        edged = boxes | np.isin(model.geom_type, others)
        self.surfaces[edged, 3] = ROUNDING
        thin = np.minimum(ROUNDING, 0.9 * model.geom_size[boxes].min(axis=1))
        self.surfaces[boxes, 3], self.surfaces[boxes, 4] = thin, 1.0
        model.geom_size[boxes] -= thin[:, None]
        model.geom_aabb[boxes, 3:] -= thin[:, None]
        model.geom_margin[edged] += 2 * ROUNDING

    def _frames(self) -> list[tuple[Array, Array]]:
        """Return the main axes of each link, and its centre of mass [m], as Bullet has them."""
        found = [(np.eye(3), np.zeros(3))] * int(self.model.nbody)
        for body, places in zip(self._bodies, self.places, strict=True):
            for index, link in enumerate(places.links.tolist()):
                frame = body.inertial_pose(index - 1)
                found[link] = frame.matrix()[:3, :3].copy(), np.array(frame.position)
        return found

    def _begin_motors(self) -> None:
        """Take dry friction of the joints that have any; others have the motor of Bullet's default."""
        force = self.motor_limits
        force[:] = 0.0
        for body, places in zip(self._bodies, self.places, strict=True):
            followers = {gear.follower for gear in body.gears}
            for joint in body.joints.values():
                dry = body.friction.get(joint.index)
                usual = 0.0 if joint.index in followers else DEFAULT_IMPULSE / self._dt
                force[places.dofs[joint.index]] = usual if dry is None else dry

    def _compiled(self) -> tuple[Any, ...]:
        """Return what `physics_step` takes; the arrays are the same for as long as the scene lives."""
        model, data = self.model, self.data
        state = (data.qpos, data.qvel, data.qfrc_applied, data.qacc_smooth, data.qacc)
        factors = data.qLD, data.qLDiagInv, model.M_rownnz, model.M_rowadr, model.M_colind
        trees = model.dof_treeid, model.tree_dofadr, model.tree_dofnum
        limits = self.motor_limits, self.strengths
        rules = (self._dt, self._sweeps, self._joint_of, self.motors, *limits, self._shares)
        links = model.geom_bodyid.astype(np.int64)
        bearers = model.body_treeid[links].astype(np.int64)
        surfaces = self.surfaces, self._geom_body, links, bearers, data.cdof, self.caps
        turned = self.ranks, (data.geom_xmat, data.geom_xpos, model.geom_size)
        places = addresses(model, data)
        written = data.qfrc_constraint, self.motor_forces
        return (
            places,
            (*state, *written),
            (*factors, *trees),
            (*rules, *surfaces, *turned),
            self.neighbours.compiled,
            self.manifolds.compiled,
            self._felt,
            self.touched,
        )

    def geoms_of(self, number: int) -> Ints:
        """Return MuJoCo's numbers of the geoms of a body, by its number in the world."""
        return self._geoms_of[number, None]

    def mark(self) -> None:
        """Remember the present state."""
        self._marked = [array.copy() for array in self._state()]

    def _state(self) -> list[Any]:
        """Return all arrays that an episode changes and the next must not see."""
        model, data = self.model, self.data
        return [
            *(data.qpos, data.qvel, data.eq_active, model.body_pos, model.body_quat, self.motors),
            *(
                self.motor_limits,
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
        self.motor_forces[:] = 0.0
        self.moved()
        self.manifolds.forget()
        touch(*self.compiled)

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
        physics_step(*self.compiled)
        self.stepped()

    def order(self, rows: Sequence[Row], bonds: Mapping[Any, int]) -> None:
        """Let rows be solved in an order.

        Args:
            rows: The order, see `RowOrder.sorted`.
            bonds: Which equality each bond is.
        """
        model, (motors, ends, equalities, is_gear) = self.model, self.ranks
        places = dict(zip(self._bodies, self.places, strict=True))
        gears = {int(model.eq_obj1id[i]): i for i in np.flatnonzero(is_gear)}
        for rank, (kind, owner, index) in enumerate(rows):
            if kind == BOND:
                equalities[bonds[owner]] = rank
            elif kind != TIE:
                dof = places[owner].dofs[index]
                joint = int(model.dof_jntid[dof])
                if kind == GEAR:
                    equalities[gears[joint]] = rank
                elif kind == MOTOR:
                    motors[dof] = rank
                else:
                    ends[joint] = rank

    def stepped(self) -> None:
        """Take note that `compiled` was stepped, and of what acted in it."""
        self.torque[:] = 0.0
        if self._pushed:
            self.data.xfrc_applied[:] = 0.0
            self._pushed = False
        self.moved()

    def loads(self, links: Ints) -> tuple[Array, ...]:
        """Return what parents put on MuJoCo's bodies `links` in the last step.

        Torque [N·m], force [N] and where from the origins of the links it is about [m], each of shape
        [n, 3], and how the links were turned, [n, 3, 3]; in the world.
        """
        middles, spots, turns = self._felt[2]
        wrenches = self.data.cfrc_int[links]
        arms = middles[self.model.body_rootid[links]] - spots[links]
        return wrenches[:, :3], wrenches[:, 3:], arms, turns[links].reshape(-1, 3, 3)

    def place_of(self, link: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return place [m] and quaternion (x, y, z, w) of one of MuJoCo's bodies in the world."""
        self.place()
        w, x, y, z = self._turns[link].tolist()
        return tuple(self._spots[link].tolist()), (x, y, z, w)

    def pose(self, link: int) -> Pose:
        """Return the pose of one of MuJoCo's bodies in the world."""
        return Pose(*self.place_of(link))

    def motion(self, link: int) -> tuple[Array, Array]:
        """Return velocity [m/s] of the origin of one of MuJoCo's bodies, and rate of turning [rad/s]."""
        self.time()
        out = np.zeros(6)
        kind = mujoco.mjtObj.mjOBJ_XBODY
        mujoco.mj_objectVelocity(self.model, self.data, kind, link, out, 0)
        return out[3:], out[:3]

    def gaps(self, links: Sequence[tuple[int, int]], other: int, within: float) -> list[float]:
        """Return how far links of bodies are from a body [m], `within` at most.

        Args:
            links: Number of a body in the world, and of its link, -1 the base.
            other: Number of a body.
            within: How far to look [m].
        """
        self.place()
        asked = tuple(links), other
        if asked not in self._compared:
            groups = [self._geoms_of.get(link, NOTHING) for link in links]
            starts = np.cumsum([0, *(len(group) for group in groups)])
            geoms = np.concatenate(groups) if groups else NOTHING
            self._compared[asked] = geoms, starts, self._geoms_of[other, None]
        return self._gaps.between(*self._compared[asked], within)

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

    def set_iterations(self, count: int) -> None:
        """Change the number of sweeps of the solver in a physics step."""
        self._sweeps[0] = count

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
            normal = side * frame[FACING]
            middle = contact.pos[i]
            one, other = contact.geom[i][own], contact.geom[i][1 - own]
            outs = self.surfaces[[one, other], 3]
            out = 0.5 * contact.dist[i] - outs
            drags = [float(forces[row + k]) if k < contact.dim[i] else 0.0 for k in (1, 2)]
            found.append(
                (
                    0,
                    self._bodies[self._geom_body[one]].uid,
                    self._bodies[self._geom_body[other]].uid,
                    int(self._geom_link[one]),
                    int(self._geom_link[other]),
                    tuple((middle + out[0] * normal).tolist()),
                    tuple((middle - out[1] * normal).tolist()),
                    tuple(normal.tolist()),
                    float(sum(out)),
                    float(forces[row]),
                    drags[0],
                    tuple((side * frame[SIDEWAYS[0]]).tolist()),
                    drags[1],
                    tuple((side * frame[SIDEWAYS[1]]).tolist()),
                )
            )
        return found
