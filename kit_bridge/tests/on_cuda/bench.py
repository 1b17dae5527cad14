"""What Python costs, and what many environments cost.

python kit_bridge/tests/on_cuda/bench.py [--only TEXT] [--json FILE]

Times are of whole calls, from frames on the device to a packet, p50 and p99. `rust` is what the same call takes below
Python (copies, device, packets), `over` is what Python and the binding cost beyond that, `submit` the engine's own
part of it. `readable` is the call without the frames' way to the engine: what precedes the submission, the device,
and all that follows until Python has the arrays. Rows `with poses` have the parts of a step of environments with
exact paths: poses brought to the host and handed over, the step with all in it, and event frames (`images`).
"""

import argparse
import collections
import functools
import itertools
import json
import time

import numpy as np
import torch

import esaac

FRAME_NS = 33_333_333
TILES = ((64, 64), (256, 64), (1024, 64), (64, 128), (256, 128), (1024, 128))
"""Environments, and pixels a side of each."""


def frames(height, width, count=32, envs=None, shift_px=2):
    """Low waves that move to the right, on the device, in float16: at 2 px a frame a tenth of an event a pixel."""
    x = torch.arange(width, device="cuda", dtype=torch.float32)
    made = []
    for index in range(count):
        phase = torch.zeros(envs or 1, 1, 1, device="cuda") + torch.arange(envs or 1, device="cuda").view(
            -1, 1, 1
        )
        row = 1 + 0.3 * torch.sin(2 * torch.pi * (x - shift_px * index + phase) / 64)
        hdr = row.expand(envs or 1, height, width).unsqueeze(-1).expand(-1, -1, -1, 4).half().contiguous()
        motion = torch.zeros(envs or 1, height, width, 2, device="cuda")
        motion[..., 0] = -shift_px
        made.append((hdr, motion) if envs else (hdr[0].clone(), motion[0].clone()))
    torch.cuda.synchronize()
    return made


def measure(step, statistics, count, warm=30):
    calls, rust, over, submit, readable, gpu, events = [], [], [], [], [], [], []
    for index in range(warm + count):
        # The same frames, wave after wave, so that buffers have grown when it counts.
        torch.cuda.synchronize()
        started = time.perf_counter_ns()
        packet = step(index)
        took = time.perf_counter_ns() - started
        if index >= warm:
            told = statistics()
            calls.append(took / 1e3)
            rust.append(told["step_ns"] / 1e3)
            over.append((took - told["step_ns"]) / 1e3)
            submit.append(told["submit_to_packet_ns"] / 1e3)
            readable.append((took - told["frames_ns"]) / 1e3)
            gpu.append(told["gpu_ns"] / 1e3)
            events.append(len(packet))
        packet = None
    middle = lambda values: sorted(values)[len(values) // 2]
    return {
        "p50_us": middle(calls),
        "p99_us": sorted(calls)[len(calls) * 99 // 100],
        "over_p50_us": middle(over),
        "rust_p50_us": middle(rust),
        "submit_p50_us": middle(submit),
        "readable_p50_us": middle(readable),
        "gpu_p50_us": middle(gpu),
        "events": middle(events),
    }


def numpy_frames():
    """For comparison: the same frames from the host."""
    camera = esaac.EventCamera("genx320", device="cuda:0")
    made = [(hdr.cpu().numpy(), motion.cpu().numpy()) for hdr, motion in frames(320, 320)]
    row = measure(
        lambda i: camera.step(*made[i % len(made)], t_ns=FRAME_NS * i), lambda: camera.statistics, 300
    )
    return {**row, "host_copies": camera.statistics["host_copies"]}


def one(packets, stream, hdr_channels=4, given=lambda tensor: tensor):
    """`given` makes of a tensor the array that is handed over."""
    camera = esaac.EventCamera("genx320", device="cuda:0", packets=packets)
    made = [(given(hdr[..., :hdr_channels].contiguous()), given(motion)) for hdr, motion in frames(320, 320)]
    row = measure(
        lambda i: camera.step(*made[i % len(made)], t_ns=FRAME_NS * i, stream=stream),
        lambda: camera.statistics,
        300,
    )
    return {**row, "host_copies": camera.statistics["host_copies"]}


def warp_array(tensor):
    import warp

    warp.config.quiet = True
    return warp.from_torch(tensor)


def cupy_array(tensor):
    import cupy

    return cupy.from_dlpack(tensor)


def many(envs, size, packets="cuda"):
    sensor = esaac.SensorModel("dvs128", width=size, height=size)
    camera = esaac.TiledEventCamera(sensor, envs, device="cuda:0", packets=packets)
    made = frames(size, size, 8 if envs * size * size > 1 << 20 else 32, envs)
    row = measure(
        lambda i: camera.step(*made[i % len(made)], t_ns=FRAME_NS * i), lambda: camera.statistics, 48, warm=24
    )
    torch.from_dlpack(camera.voxel_grids(5))
    torch.cuda.synchronize()
    started = time.perf_counter_ns()
    grids = torch.from_dlpack(camera.voxel_grids(5))
    torch.cuda.synchronize()
    grids_us = (time.perf_counter_ns() - started) / 1e3
    uses = camera.memory()
    return {
        **row,
        "voxel_grids_us": grids_us,
        "grid_mb": grids.numel() * 4 / 1e6,
        "device_mb": sum(use["bytes"] for use in uses if not use["on_host"]) / 1e6,
        "ns_per_pixel": 1e3 * row["p50_us"] / (envs * size * size),
        "pixels": envs * size * size,
    }


class Throw:
    """Environments in which a textured board slides before a textured wall, seen by a still camera: what renderer and
    physics would give of them, on the device."""

    FOCAL_PX, WALL_M, BOARD_M, SPEED_M_S, SUBSTEPS = 60.0, 4.0, 2.0, 1.2, 8

    def __init__(self, envs, size):
        self._size = size
        self._start_m = torch.linspace(-0.8, 0.2, envs, device="cuda")
        along = (torch.arange(size, device="cuda") + 0.5 - size / 2) / self.FOCAL_PX
        self._x, self._y = along[None, None, :], along[None, :, None]
        self.lens = esaac.Intrinsics(
            self.FOCAL_PX, self.FOCAL_PX, size / 2, size / 2, half_pixel_centres=True
        )
        self._poses = torch.zeros(self.SUBSTEPS + 3, envs, 7, device="cuda")
        self._poses[..., 2], self._poses[..., 6] = -self.BOARD_M, 1.0
        self._cameras = np.zeros((self.SUBSTEPS + 3, envs, 7))
        self._cameras[..., 6] = 1.0

    def frame(self, t_s):
        """Colour, depth, ids."""
        own = self._x * self.BOARD_M - (self._start_m + self.SPEED_M_S * t_s)[:, None, None]
        board = (own.abs() < 0.4) & ((self._y * self.BOARD_M).abs() < 0.5)
        wall = 0.5 + 0.2 * torch.sin(9 * self.WALL_M * self._x) * torch.sin(7 * self.WALL_M * self._y)
        light = torch.where(board, 0.5 + 0.3 * torch.sin(11 * own), wall)
        depth = torch.where(board, self.BOARD_M, self.WALL_M)
        return light.unsqueeze(-1).expand(*light.shape, 3).contiguous(), depth, board.to(torch.int32)

    def poses(self, t_ns):
        """Of all substeps since the frame before, and two before them, as `esaac.newton` brings them to the host."""
        times_ns = t_ns + (np.arange(-self.SUBSTEPS - 2, 1) * FRAME_NS) // self.SUBSTEPS
        at_s = torch.from_numpy(times_ns * 1e-9).to("cuda", torch.float32)
        self._poses[..., 0] = self._start_m + self.SPEED_M_S * at_s[:, None]
        return times_ns, self._cameras, self._poses[:, :, None].cpu().numpy()


def posed(envs, size, synthesis="rigid"):
    """A step with exact paths, and where its time goes: bringing poses to the host, handing them over (`Poses`), the
    step (of that, until the frames have been copied, and from submission to packets), and event frames afterwards."""
    throw = Throw(envs, size)
    sensor = esaac.SensorModel("dvs128", width=size, height=size, profile="noisy", synthesis=synthesis)
    camera = esaac.TiledEventCamera(sensor, envs, device="cuda:0", packets="cuda", intrinsics=throw.lens)
    made = [throw.frame(index / 30) for index in range(16)]
    parts = collections.defaultdict(list)
    for index in range(64):
        camera.reset() if index % len(made) == 0 else None
        hdr, depth, ids = made[index % len(made)]
        t_ns = FRAME_NS * (index + 1)
        torch.cuda.synchronize()
        marks = [time.perf_counter_ns()]
        given = throw.poses(t_ns)
        marks.append(time.perf_counter_ns())
        poses = esaac.Poses(*given)
        marks.append(time.perf_counter_ns())
        packet = camera.step(hdr, t_ns=t_ns, depth=depth, ids=ids, poses=poses)
        marks.append(time.perf_counter_ns())
        torch.from_dlpack(camera.event_frames())
        torch.cuda.synchronize()
        marks.append(time.perf_counter_ns())
        if index < len(made) or index % len(made) == 0:
            continue
        told = camera.statistics
        for name, took_ns in zip(("bring", "hand_over", "step", "images"), np.diff(marks)):
            parts[name].append(float(took_ns) / 1e3)
        parts["all"].append((marks[-1] - marks[0]) / 1e3)
        for name, of in (("frames", "frames_ns"), ("device", "submit_to_packet_ns"), ("gpu", "gpu_ns")):
            parts[name].append(told[of] / 1e3)
    middle = lambda values: sorted(values)[len(values) // 2]
    row = {f"{name}_us": middle(values) for name, values in parts.items()}
    return {**row, "events": len(packet), "host_copies": camera.statistics["host_copies"]}


def vga(envs, packets, on_host):
    """How much longer than the GPU's work takes it until Python has the arrays of every environment?"""
    camera = esaac.TiledEventCamera("vga", envs, profile="noisy", device="cuda:0", packets=packets)
    made = frames(480, 640, 6, envs, shift_px=8)
    if on_host:
        made = [(hdr.cpu().numpy(), motion.cpu().numpy()) for hdr, motion in made]
    in_place = packets == "mapped"

    def step(index):
        packet = camera.step(*made[index % len(made)], t_ns=FRAME_NS * index)
        # Arrays of copied packets are there. Those over mapped memory are made of each environment's packet.
        for part in map(packet.__getitem__, range(envs)) if in_place else ():
            assert len(part.x) == len(part.y) == len(part.p) == len(part.t_offset_ns)
        return packet

    row = measure(step, lambda: camera.statistics, 96, warm=24)
    return {**row, "readable_over_gpu": row["readable_p50_us"] / row["gpu_p50_us"]}


def beside_work(packets, submits, size=320):
    """Steps beside other work of the GPU in the same stream, a few hundred microseconds of it: after each step, or
    while it runs. `work_us` is what the work takes alone, `submit_us` and `packet_us` the caller's time in each call
    of the camera (without `submit`, the first is the step), `period_us` all of it."""
    camera = esaac.EventCamera("genx320", device="cuda:0", packets=packets)
    made, big = frames(size, size), torch.randn(2048, 2048, device="cuda")

    def work():
        for _ in range(3):
            big @ big

    work()
    torch.cuda.synchronize()
    started = time.perf_counter_ns()
    for _ in range(100):
        work()
    torch.cuda.synchronize()
    work_us = (time.perf_counter_ns() - started) / 1e5
    called, count, warm = [], 300, 30
    for index in range(warm + count):
        if index == warm:
            torch.cuda.synchronize()
            began = time.perf_counter_ns()
        frame, t_ns = made[index % len(made)], FRAME_NS * index
        before = time.perf_counter_ns()
        packet = camera.submit(*frame, t_ns=t_ns) if submits else camera.step(*frame, t_ns=t_ns)
        submitted = time.perf_counter_ns()
        work()
        worked = time.perf_counter_ns()
        packet = camera.packet() if submits else packet
        if index >= warm:
            called.append((submitted - before, time.perf_counter_ns() - worked))
    torch.cuda.synchronize()
    period_us = (time.perf_counter_ns() - began) / 1e3 / count
    submit_us, packet_us = (sorted(part)[count // 2] / 1e3 for part in zip(*called))
    return {"period_us": period_us, "work_us": work_us, "submit_us": submit_us, "packet_us": packet_us}


def line(rows, of):
    """`of` as a line over pixels, by least squares of relative errors: at no pixels, per million, largest error."""
    pixels = np.array([row["pixels"] for row in rows]) / 1e6
    values = np.array([row[of] for row in rows])
    weighted = np.stack([1 / values, pixels / values], axis=1)
    (at_none, per_million), *_ = np.linalg.lstsq(weighted, np.ones(len(rows)), rcond=None)
    worst = np.abs((at_none + per_million * pixels) / values - 1).max()
    return {"at_none": at_none, "per_million_px": per_million, "worst_error": worst}


def table(rows):
    """For the README."""
    print("| environments, one call, all on the GPU | p50 | ns a pixel | device memory |\n|---|---|---|---|")
    for name, row in rows.items():
        print(
            f"| {name} | {row['p50_us'] / 1e3:.2f} ms | {row['ns_per_pixel']:.2f} | {row['device_mb']:.0f} MB |"
        )


def show_tiles(tiles):
    """Prints the table and how linear its figures are in pixels."""
    table(tiles)
    fits = {of: line(list(tiles.values()), of) for of in ("p50_us", "device_mb")}
    for of, fit in fits.items():
        print(
            f"{of} = {fit['at_none']:.1f} + {fit['per_million_px']:.1f} a million pixels, at most "
            f"{100 * fit['worst_error']:.0f}% off"
        )
    return fits


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", metavar="TEXT", default="", help="rows whose names contain this")
    parser.add_argument("--json", metavar="FILE")
    arguments = parser.parse_args()
    default = torch.cuda.default_stream().cuda_stream
    cases = {
        "320x320 x32, frames and packets on the host": numpy_frames,
        "320x320 x32, packets on the host": lambda: one("host", None),
        "320x320 x32, packets on the host, stream named": lambda: one("host", default),
        "320x320 x32, packets on the device": lambda: one("cuda", None),
        "320x320 x32, packets on the device, stream named": lambda: one("cuda", default),
        "320x320 x32, three channels, stream named": lambda: one("host", default, 3),
        "320x320 x32, Warp arrays, packets on the host": lambda: one("host", None, given=warp_array),
        "320x320 x32, CuPy arrays, packets on the host": lambda: one("host", None, given=cupy_array),
    }
    for packets, submits in itertools.product(("host", "cuda"), (False, True)):
        name = f"320x320 x32 beside work, packets `{packets}`, {'submitted' if submits else 'stepped'}"
        cases[name] = functools.partial(beside_work, packets, submits)
    for envs, frames_of, packets in itertools.product((8, 64), ("NumPy", "torch"), ("host", "mapped")):
        name = f"{envs} x VGA x32, frames of {frames_of}, packets `{packets}`"
        cases[name] = functools.partial(vga, envs, packets, frames_of == "NumPy")
    for envs, synthesis in itertools.product((64, 256, 1024), ("rigid", "linear")):
        cases[f"{envs} of 64x64 with poses, {synthesis}"] = functools.partial(posed, envs, 64, synthesis)
    tiles = {f"{envs} of {size}x{size}": functools.partial(many, envs, size) for envs, size in TILES}
    rows = {}
    for name, case in (cases | tiles).items():
        if arguments.only in name:
            rows[name] = case()
            print(name, {key: round(value, 2) for key, value in rows[name].items()}, flush=True)
    if not rows:
        parser.error(f"no row's name contains `{arguments.only}`")
    if all(name in rows for name in tiles):
        rows["linear in pixels"] = show_tiles({name: rows[name] for name in tiles})
    if arguments.json:
        with open(arguments.json, "w") as file:
            json.dump(rows, file, indent=1)


if __name__ == "__main__":
    main()
