"""MuJoCo scenes.

`model`: textured boxes slide, turn and fall before a textured wall, seen by two cameras. One is still, the other sits
on a platform that shakes and turns. `yard`: chequers with hard edges and plain colours, as MuJoCo's own textures are,
and a still camera. Nothing of it was chosen by its score.
"""

import mujoco
import numpy as np

PHYSICS_HZ, POSES_HZ, FRAME_HZ, TRUTH_HZ = 960, 240, 30, 960
WIDTH, HEIGHT = 64, 48

# Parts of the worlds of `XML` and of `batch_scene`.
WALLS = """    <geom name="wall" type="plane" size="4 4 .1" pos="0 3 0" euler="90 0 0" material="wall"/>
    <geom name="floor" type="box" size="3 2 .05" pos="0 1 -.85" rgba=".4 .4 .45 1"/>
"""
CAMERAS = """    <camera name="still" pos="0 -.6 .1" xyaxes="1 0 0 0 0 1" fovy="50"/>
    <camera name="asymmetric" pos="0 -.6 .1" xyaxes="1 0 0 0 0 1" sensorsize=".004 .003" resolution="64 48"
      focal=".004 .0035" principal=".0003 -.0002"/>
    <body name="platform" pos="0 -.6 .1">
      <joint name="slide" type="slide" axis="1 0 0" stiffness="900" damping="0"/>
      <joint name="pan" type="hinge" axis="0 .1 1" stiffness="40" damping="0"/>
      <inertial pos="0 0 0" mass="1" diaginertia=".02 .02 .02"/>
      <camera name="shaken" xyaxes="1 0 0 0 0 1" fovy="50"/>
    </body>
"""

XML = """
<mujoco>
  <option timestep="{step}" integrator="implicitfast"/>
  <visual>
    <headlight ambient=".6 .6 .6" diffuse=".4 .4 .4" specular="0 0 0"/>
    <quality shadowsize="0"/>
  </visual>
  <asset>
    <texture name="waves" type="2d" builtin="flat" width="256" height="256"/>
    <texture name="boxes" type="cube" builtin="flat" width="64" height="64"/>
    <material name="wall" texture="waves" texrepeat="2 2"/>
    <material name="box" texture="boxes"/>
  </asset>
  <worldbody>
{walls}    <body name="thrown" pos="-.7 1.6 .2">
      <freejoint/>
      <geom type="box" size=".3 .2 .25" material="box"/>
    </body>
    <body name="swings" pos=".6 1.9 .9">
      <joint type="hinge" axis="0 1 0" damping=".01"/>
      <geom type="box" size=".12 .12 .35" pos="0 0 -.5" material="box"/>
    </body>
{cameras}  </worldbody>
</mujoco>
"""


YARD = """
<mujoco>
  <option timestep="{step}" integrator="implicitfast"/>
  <visual>
    <headlight ambient=".4 .4 .4" diffuse=".3 .3 .3" specular=".1 .1 .1"/>
    <quality shadowsize="0"/>
  </visual>
  <asset>
    <texture name="chequers" type="2d" builtin="checker" rgb1=".3 .3 .35" rgb2=".6 .6 .55" width="256" height="256"/>
    <texture name="shades" type="2d" builtin="gradient" rgb1=".3 .45 .6" rgb2=".7 .7 .6" width="128" height="128"/>
    <texture name="marks" type="cube" builtin="checker" rgb1=".75 .3 .2" rgb2=".8 .7 .3" width="64" height="64"/>
    <material name="floor" texture="chequers" texrepeat="5 5"/>
    <material name="wall" texture="shades"/>
    <material name="marked" texture="marks"/>
  </asset>
  <worldbody>
    <light pos="1 -2 3" dir="-.3 .7 -1" directional="true" castshadow="false" diffuse=".4 .4 .4"/>
    <geom type="plane" size="4 4 .1" material="floor"/>
    <geom type="box" size="4 .1 3" pos="0 3 3" material="wall"/>
    <body pos="-1 1.4 1"><freejoint/><geom type="sphere" size=".25" material="marked"/></body>
    <body pos=".8 1.7 .3"><freejoint/><geom type="box" size=".25 .2 .15" rgba=".25 .5 .35 1"/></body>
    <body pos="0 2 1.9">
      <joint type="hinge" axis="0 1 0"/>
      <geom type="capsule" size=".07" fromto="0 0 0 0 0 -1" rgba=".7 .7 .75 1"/>
    </body>
    <camera name="yard" pos="0 -1 1" xyaxes="1 0 0 0 0 1" fovy="50"/>
  </worldbody>
</mujoco>
"""


def texture(seed, shape, most):
    """Smooth waves without seams, `most` along each side: bytes."""
    random = np.random.default_rng(seed)
    v, u = np.meshgrid(*[np.arange(side) * 2 * np.pi / side for side in shape], indexing="ij")
    waves = [
        np.sin(random.integers(1, most + 1) * u + random.integers(-most, most + 1) * v + phase)
        for phase in random.uniform(0, 6, 6)
    ]
    return np.clip(150 + 26 * np.sum(waves, axis=0), 30, 250).astype(np.uint8)


def model():
    made = mujoco.MjModel.from_xml_string(XML.format(step=1 / PHYSICS_HZ, walls=WALLS, cameras=CAMERAS))
    for name, most, faces in (("waves", 6, 1), ("boxes", 2, 6)):
        number = made.texture(name).id
        width, height = made.tex_width[number], made.tex_height[number]
        paint(
            made,
            number,
            np.concatenate([texture(face, (height // faces, width), most) for face in range(faces)]),
        )
    return made


def paint(made, number, grey):
    """Gives a texture of a model these bytes of grey."""
    start = made.tex_adr[number]
    made.tex_data[start : start + grey.size * 3] = np.repeat(grey.reshape(-1, 1), 3, axis=1).ravel()


def begun(made):
    """The state at time 0."""
    data = mujoco.MjData(made)
    data.qvel[:6] = (1.6, 0.0, 2.0, 2.0, -3.0, 4.0)
    data.qpos[7] = 0.8
    data.qvel[7:] = 1.2, 2.0
    mujoco.mj_forward(made, data)
    return data


def yard():
    return mujoco.MjModel.from_xml_string(YARD.format(step=1 / PHYSICS_HZ))


def yard_begun(made):
    """The state at time 0: a ball and a box are thrown, a pendulum swings."""
    data = mujoco.MjData(made)
    data.qvel[:] = (2.5, 0, 1.5, 2, 4, 1, -1.2, 0, 1, 0, 2, 3, 2.5)
    mujoco.mj_forward(made, data)
    return data
