"""Events of a MuJoCo simulation along the paths of its physics steps, from frames at 30 Hz.

    MUJOCO_GL=egl python kit_bridge/scripts/mujoco_events.py --out events.npz

A box tumbles before a chequered wall, and a camera swings on an arm. Needs `mujoco`. Without a screen `MUJOCO_GL`
chooses what draws: `egl` (a GPU, or Mesa's software driver) or `osmesa`.
"""

import argparse

PARSER = argparse.ArgumentParser(description=__doc__.splitlines()[0])
PARSER.add_argument("--seconds", type=float, default=0.5)
PARSER.add_argument("--width", type=int, default=160)
PARSER.add_argument("--height", type=int, default=120)
PARSER.add_argument("--out", help="a recording: .npz, or .h5 with h5py")

if __name__ == "__main__":
    # `--help` needs none of the packages below.
    PARSER.parse_args()

import mujoco

import esaac
from esaac.mujoco import EventCamera

FRAME_HZ = 30

SCENE = """
<mujoco>
  <option timestep=".002"/>
  <asset>
    <texture name="chequers" type="2d" builtin="checker" rgb1=".3 .3 .35" rgb2=".7 .7 .65" width="256" height="256"/>
    <material name="wall" texture="chequers" texrepeat="6 6"/>
  </asset>
  <worldbody>
    <light pos="0 -2 3" dir="0 1 -1" castshadow="false"/>
    <geom type="plane" size="4 4 .1" pos="0 2 0" euler="90 0 0" material="wall"/>
    <body pos="-.6 1.2 .2">
      <freejoint/>
      <geom type="box" size=".2 .15 .1" rgba=".8 .3 .2 1"/>
    </body>
    <body pos="0 0 1">
      <joint type="hinge" axis="0 1 0"/>
      <geom type="capsule" size=".02" fromto="0 0 0 0 0 -.8"/>
      <camera name="eye" pos="0 .1 -1" xyaxes="1 0 0 0 0 1" fovy="50"/>
    </body>
  </worldbody>
</mujoco>
"""


def main(arguments=None):
    given = PARSER.parse_args(arguments)
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    data.qvel[:6] = 1.5, 0, 2.5, 2, 3, 1
    data.qpos[7] = 0.3
    sensor = esaac.SensorModel("davis346", width=given.width, height=given.height, profile="noisy")
    packets, frames = [], 0
    with EventCamera(model, "eye", sensor) as camera:
        while data.time < given.seconds:
            camera.record(data)
            if data.time * FRAME_HZ >= frames - 1e-6:
                packets.append(camera.step(data))
                frames += 1
            mujoco.mj_step(model, data)
        synthesis = camera.events.synthesis
    count = sum(map(len, packets))
    print(f"{count} events of {frames} frames and {data.time / model.opt.timestep:.0f} poses ({synthesis})")
    if given.out:
        with esaac.EventWriter(given.out, sensor) as writer:
            for packet in packets:
                writer.write(packet)
    return count, synthesis


if __name__ == "__main__":
    main()
