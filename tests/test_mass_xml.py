"""Musculatures read from MASS files."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from rcare_marl.agents.people.actuation.mass_xml import BODIES
from rcare_marl.agents.people.actuation.muscle_unit import t_pose_length, t_pose_position
from rcare_marl.agents.people.actuation.musculature import load_musculature
from rcare_marl.agents.people.avatar import body_model, load_avatar
from rcare_marl.agents.people.body.skeleton import JOINT_INDEX
from rcare_marl.errors import ConfigError, UnknownNameError

Array = npt.NDArray[np.float64]
ROOT = Path(__file__).resolve().parents[1]


# ---- MASS

MASS = """<Muscle>
<Unit name="L_Biceps" f0="1000" lm="1.0" lt="0.2" pen_angle="0" lmax="-0.1">
  <Waypoint body="ShoulderL" p="0.18 1.45 -0.01"/><Waypoint body="ArmL" p="0.44 1.44 0.01"/>
  <Waypoint body="ForeArmL" p="0.53 1.435 0.02"/></Unit>
<Unit name="R_Biceps" f0="1000" lm="1.0" lt="0.2" pen_angle="0" lmax="-0.1">
  <Waypoint body="ShoulderR" p="-0.18 1.45 -0.01"/><Waypoint body="ArmR" p="-0.44 1.44 0.01"/>
  <Waypoint body="ForeArmR" p="-0.53 1.435 0.02"/></Unit>
<Unit name="L_Soleus" f0="3549" lm="1.2" lt="0.2" pen_angle="0.4" lmax="-0.1">
  <Waypoint body="TibiaL" p="0.09 0.36 0"/><Waypoint body="TalusL" p="0.08 0.07 -0.045"/></Unit>
<Unit name="L_Rectus_Abdominis" f0="1000" lm="1.2" lt="0.2" pen_angle="0" lmax="-0.1">
  <Waypoint body="Pelvis" p="0.02 0.92 0.07"/><Waypoint body="Torso" p="0.05 1.3 0.09"/></Unit>
</Muscle>"""


def mass_file(tmp_path: Path, text: str = MASS) -> Path:
    file = tmp_path / "muscle.xml"
    file.write_text(text, encoding="utf-8")
    return file


def test_mass_units_get_metres_joints_and_clinical_groups(tmp_path: Path) -> None:
    found = load_musculature(mass_file(tmp_path))
    biceps, twin, soleus, abdominal = found.units
    lengths = [t_pose_length(unit.path, found.joints) for unit in found.units]
    assert (biceps.clinical_group, biceps.side) == ("elbow_flexors", "left")
    assert (twin.clinical_group, twin.side) == ("elbow_flexors", "right")
    assert (soleus.clinical_group, soleus.side) == ("ankle_plantarflexors", "left")
    assert (abdominal.clinical_group, abdominal.side) == ("trunk", "axial")
    assert [point.joint for point in biceps.path] == ["left_collar", "left_shoulder", "left_elbow"]
    assert biceps.optimal_fiber_length == pytest.approx(1.0 * lengths[0])
    assert soleus.optimal_fiber_length == pytest.approx(1.2 * lengths[2])
    assert soleus.tendon_slack_length == pytest.approx(0.2 * lengths[2])
    assert soleus.pennation == 0.4
    points = [t_pose_position(point, found.joints) for point in soleus.path]
    assert np.allclose(points, ((0.09, 0.36, 0), (0.08, 0.07, -0.045)))
    assert "placeholder" in biceps.source
    avatar = load_avatar("daniel")
    fitted = found.fitted(body_model(avatar.body_path(), avatar.height_m).joints)
    assert dataclasses.asdict(fitted.units[2])["clinical_group"] == "ankle_plantarflexors"


def test_mass_skeletons_place_the_joints(tmp_path: Path) -> None:
    ours = load_musculature().joints
    nodes = []
    for body, joint in BODIES.items():
        x, y, z = ours[JOINT_INDEX[joint]] * 1.05
        nodes.append(
            f'<Node name="{body}" parent="None"><Joint type="Ball"><Transformation linear="1 0 0 0 1 '
            f'0 0 0 1" translation="{x} {y} {z}"/></Joint></Node>'
        )
    skeleton = tmp_path / "human.xml"
    skeleton.write_text(f"<Skeleton>{''.join(nodes)}</Skeleton>", encoding="utf-8")
    found = load_musculature(mass_file(tmp_path), skeleton=skeleton)
    named = [JOINT_INDEX[joint] for joint in BODIES.values()]
    assert np.allclose(found.joints[named], 1.05 * ours[named])
    assert np.isfinite(found.joints).all()
    skeleton.write_text(f"<Skeleton>{''.join(nodes[1:])}</Skeleton>", encoding="utf-8")
    with pytest.raises(ConfigError, match="lacks the nodes Pelvis"):
        load_musculature(mass_file(tmp_path), skeleton=skeleton)


@pytest.mark.parametrize(
    ("old", "new", "error", "message"),
    [
        ("TibiaL", "TibeaL", UnknownNameError, "Did you mean 'TibiaL'"),
        ('f0="3549"', 'f0="many"', ConfigError, "f0 must be a number"),
        ('lm="1.2"', 'lm="-1"', ConfigError, "lm must lie in"),
        ("0.09 0.36 0", "0.09 0.36", ConfigError, "three numbers"),
        ("R_Biceps", "L_Biceps", ConfigError, "stands twice"),
        ("</Muscle>", "", ConfigError, "not valid XML"),
        ('<Waypoint body="TibiaL" p="0.09 0.36 0"/>', "", ConfigError, "at least two waypoints"),
    ],
)
def test_a_wrong_mass_file_is_named(
    tmp_path: Path, old: str, new: str, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        load_musculature(mass_file(tmp_path, MASS.replace(old, new)))
