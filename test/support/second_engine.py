"""The exported model in MuJoCo, as an independent second engine of arms, rods and plate."""

import numpy as np
import pytest

from delta3_pacdrive import kinematics
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.robot.sercos.telegrams import JOINTS
from delta3_pacdrive.scene.joints import joints
from delta3_pacdrive.scene.mjcf import mjcf
from delta3_pacdrive.scene.parts import RODS


def engine_of(robot, *, rods=False):
    """The exported model: arms, six rods on universal joints, and a free plate."""
    mujoco = pytest.importorskip('mujoco', reason='the second engine, MuJoCo, is not installed')
    model = mujoco.MjModel.from_xml_string(mjcf(robot, rods=rods))
    return mujoco, model, mujoco.MjData(model)


def loops(engine, of_site):
    """Return values of a function of MuJoCo at the sites: rows (18, 21) of rod ends less joints on the plate."""
    _, model, _ = engine
    rows = np.zeros((2, 6, 3, model.nv))
    for n, rod in enumerate(RODS):
        for side, name in enumerate((f'forearm{rod}_end', f'plate_{rod}')):
            of_site(model.site(name).id, rows[side, n])
    return (rows[0] - rows[1]).reshape(18, model.nv)


def closed_chain(engine, theta, thetadot, tau, robot):
    """MuJoCo's tree with its six loops closed by exact constraints: accelerations of arms, velocity and acceleration of
    the plate, and the forces of the plate on the rods, (6, 3)."""
    mujoco, model, data = engine
    tcp = kinematics.forward(theta, robot.kinematics)
    for name, angle in zip(JOINTS, joints(theta, robot), strict=True):
        if not name.startswith('plate'):  # it is free here, and hangs on a rod in a tree
            data.joint(name).qpos[:] = angle
    data.joint('plate').qpos[:] = [*tcp, 1.0, 0.0, 0.0, 0.0]
    mujoco.mj_forward(model, data)
    for rod in RODS:
        apart = data.site(f'forearm{rod}_end').xpos - data.site(f'plate_{rod}').xpos
        assert np.abs(apart).max() < 1e-12
    rows = loops(engine, lambda site, out: mujoco.mj_jacSite(model, data, out, None, site))
    arms = [int(model.joint(axis).dofadr[0]) for axis in DRIVES]
    others = np.setdiff1d(np.arange(model.nv), arms)
    data.qvel[arms] = thetadot
    data.qvel[others] = np.linalg.solve(rows[:, others], -rows[:, arms] @ thetadot)
    plate = int(model.joint('plate').dofadr[0])
    moved = kinematics.jacobian(theta, tcp, robot.kinematics) @ thetadot
    assert data.qvel[plate : plate + 6] == pytest.approx([*moved, 0.0, 0.0, 0.0], abs=1e-9)
    mujoco.mj_forward(model, data)

    def rate_of_jacobian(site, out):
        mujoco.mj_jacDot(model, data, out, None, data.site_xpos[site], model.site_bodyid[site])

    rates = loops(engine, rate_of_jacobian)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    saddle = np.block([[mass, rows.T], [rows, np.zeros((18, 18))]])
    force = -data.qfrc_bias
    force[arms] += tau
    found = np.linalg.solve(saddle, np.append(force, -rates @ data.qvel))
    of_plate = slice(plate, plate + 3)
    return found[arms], data.qvel[of_plate].copy(), found[of_plate], -found[model.nv :].reshape(6, 3)
