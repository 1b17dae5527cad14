"""Worlds of MuJoCo Warp: textured boxes slide, turn and fall before a textured wall, otherwise in each world, seen by
a still camera and by one on a platform that shakes and turns. Its renderer has textures on planes and meshes only."""

import os

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp
from mujoco_scene import CAMERAS, PHYSICS_HZ, WALLS, paint, texture

wp.config.quiet = True
wp.set_device(os.environ.get("ESAAC_NEWTON_DEVICE", "cpu"))

WORLDS = 2

XML = """
<mujoco>
  <option timestep="{step}" integrator="implicitfast"/>
  <visual><headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/></visual>
  <asset>
    <texture name="waves" type="2d" builtin="flat" width="256" height="256"/>
    <texture name="boxes" type="2d" builtin="flat" width="128" height="128"/>
    <material name="wall" texture="waves" texrepeat=".5 .5"/>
    <material name="box" texture="boxes"/>
    <mesh name="box" {box}/>
  </asset>
  <worldbody>
{walls}    <body name="thrown" pos="-.7 1.6 .2">
      <freejoint/>
      <geom type="mesh" mesh="box" material="box"/>
    </body>
    <body name="swings" pos=".6 1.9 .9">
      <joint type="hinge" axis="0 1 0" damping=".01"/>
      <geom type="mesh" mesh="box" pos="0 0 -.5" material="box"/>
    </body>
{cameras}    <camera name="square" pos="0 -.6 .1" xyaxes="1 0 0 0 0 1" sensorsize=".003 .003" resolution="48 48"
      focal=".003 .0032" principal=".0003 -.0002"/>
  </worldbody>
</mujoco>
"""


def box():
    """A mesh of which each side has the whole texture."""
    half = np.array([0.3, 0.2, 0.25])
    square, vertices, faces = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]), [], []
    for axis in range(3):
        for side in (-1, 1):
            corners = np.full((4, 3), float(side))
            corners[:, [(axis + 1) % 3, (axis + 2) % 3]] = square[::side]
            faces += [np.array(triangle) + len(vertices) for triangle in ((0, 1, 2), (0, 2, 3))]
            vertices += list(corners * half)
    listed = lambda rows: " ".join(f"{value:g}" for value in np.ravel(rows))
    sides = np.tile((square + 1) / 2, (6, 1))
    return f'vertex="{listed(vertices)}" texcoord="{listed(sides)}" face="{listed(faces)}"'


def host_model():
    made = mujoco.MjModel.from_xml_string(
        XML.format(step=1 / PHYSICS_HZ, box=box(), walls=WALLS, cameras=CAMERAS)
    )
    for name, most in (("waves", 6), ("boxes", 2)):
        number = made.texture(name).id
        width, height = made.tex_width[number], made.tex_height[number]
        paint(made, number, texture(number, (height, width), most))
    return made


class Moving:
    """Worlds whose bodies begin with velocities of their own."""

    def __init__(self, worlds=WORLDS):
        self.host_model = host_model()
        self.model = mjw.put_model(self.host_model)
        self.data = mjw.make_data(self.host_model, nworld=worlds)
        # A graph takes a thousandth of the time, and must not load kernels.
        mjw.step(self.model, self.data)
        with wp.ScopedCapture() as capture:
            mjw.step(self.model, self.data)
        self._step = capture.graph
        self.begin(range(worlds))

    def begin(self, worlds):
        """Sets worlds to the state at time 0."""
        chosen = np.zeros(self.data.nworld, bool)
        chosen[worlds] = True
        mjw.reset_data(self.model, self.data, wp.array(chosen, dtype=bool))
        places, speeds = self.data.qpos.numpy(), self.data.qvel.numpy()
        for world in worlds:
            faster = 1 - 0.3 * world
            places[world, 7] = 0.8
            speeds[world] = np.array((1.6, 0, 2, 2, -3, 4, 1.2, 1.2, 2)) * faster
        self.data.qpos.assign(places)
        self.data.qvel.assign(speeds)

    def step(self):
        wp.capture_launch(self._step)
