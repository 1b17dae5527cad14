"""Newton worlds whose bodies move along paths in closed form, so that any moment can be rendered: the truth."""

import os

import newton
import numpy as np
import warp as wp

wp.config.quiet = True

DEVICE = os.environ.get("ESAAC_NEWTON_DEVICE", "cpu")
PHYSICS_HZ, FRAME_HZ, TRUTH_HZ = 240, 30, 960
WIDTH, HEIGHT, FOCAL_PX = 64, 48, 60.0
LENS = (FOCAL_PX, FOCAL_PX, (WIDTH - 1) / 2, (HEIGHT - 1) / 2)
STILL = np.array([0, 0, 0, 0, 0, 0, 1], float)
BOX, LINK = 0, 1
"""Numbers of the bodies of each world: what is looked at, and what a camera may sit on."""
APART_M, WALL_M = 40.0, -3.0


def turned(axis, angle):
    """A quaternion x y z w."""
    axis = np.asarray(axis, float) / np.linalg.norm(axis)
    return np.array([*(axis * np.sin(angle / 2)), np.cos(angle / 2)])


def box_at(t, world):
    place = [2.0 * t - 0.3, 0.3 * np.sin(12 * t + 0.4 * world), -1.8]
    return np.array([*place, *turned((0.3, 1, 0.2), 2 * t - 0.5 * world)])


def link_at(t, world):
    """Shakes and turns, fast."""
    shake = 0.04 * np.sin(2 * np.pi * 7 * t + world) + 0.02 * np.sin(2 * np.pi * 11 * t)
    return np.array([0.05 * np.sin(2 * np.pi * 3 * t), 0.02 * t, 0, *turned((0.4, 1, 0.1), shake)])


def texture(seed, most):
    """Smooth waves without seams, `most` along each side: bytes of sRGB."""
    random = np.random.default_rng(seed)
    v, u = np.meshgrid(*[np.arange(512) * 2 * np.pi / 512] * 2, indexing="ij")
    waves = [
        np.sin(random.integers(1, most + 1) * u + random.integers(-most, most + 1) * v + phase)
        for phase in random.uniform(0, 6, 6)
    ]
    grey = np.clip(150 + 26 * np.sum(waves, axis=0), 30, 250).astype(np.uint8)
    return np.repeat(grey[..., None], 4, axis=-1)


def textured(mesh, seed, most):
    waves = texture(seed, most)
    return newton.Mesh(mesh.vertices, mesh.indices, normals=mesh.normals, uvs=mesh.uvs, texture=waves)


def model(worlds):
    one = newton.ModelBuilder()
    wall = wp.transform((0.0, 0.0, WALL_M), wp.quat_identity())
    white = (1.0, 1.0, 1.0)
    one.add_shape_mesh(-1, xform=wall, mesh=textured(newton.Mesh.create_plane(6.0, 6.0), 1, 8), color=white)
    for label in ("box", "link"):
        one.add_body(label=label, mass=1.0, inertia=wp.mat33(np.eye(3)))
    one.add_shape_mesh(BOX, mesh=textured(newton.Mesh.create_box(0.4, 0.3, 0.25), 2, 4), color=white)
    together = newton.ModelBuilder()
    together.replicate(one, worlds, spacing=(APART_M, 0.0, 0.0))
    return together.finalize(device=DEVICE)


def origins(made):
    """Where Newton has put each world."""
    walls = made.shape_transform.numpy()[made.shape_body.numpy() < 0, :3]
    return walls - (0, 0, WALL_M)


def bodies_at(t, places):
    """All bodies of all worlds, at a time or at one for each."""
    times = np.broadcast_to(t, len(places))
    poses = np.array([of(times[world], world) for world in range(len(places)) for of in (box_at, link_at)])
    poses[:, :3] += np.repeat(places, 2, axis=0)
    return poses


class Moving:
    """A model whose state is set to any time, or each world's to another."""

    def __init__(self, worlds):
        self.worlds, self.model = worlds, model(worlds)
        self.state = self.model.state()
        self.origins = origins(self.model)

    def at(self, t):
        self.state.body_q.assign(bodies_at(t, self.origins).astype(np.float32))
        return self.state

    def mounted(self, on_link):
        """Options of a camera on the link, or still in each world."""
        if on_link:
            return {"places": STILL, "bodies": [2 * world + LINK for world in range(self.worlds)]}
        places = np.tile(STILL, (self.worlds, 1))
        places[:, :3] = self.origins
        return {"places": places}
