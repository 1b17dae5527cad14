"""A program that uses every name of the package, for a type checker; it is not run."""

import numpy as np

import esaac


def use() -> None:
    sensor = esaac.SensorModel("davis346", profile="noisy", contrast_on=0.2)
    rate: float = sensor.replace(seed=7).leak_rate_hz
    names: list[str] = [name for name, _, _ in esaac.SensorModel.parameters()]
    frame = np.zeros((260, 346, 4), np.float32)
    with esaac.EventCamera(sensor, device="cuda:0", packets="cuda") as camera:
        packet: esaac.Packet = camera.step(frame, t_ns=0, depth=None)
        camera.sensor = sensor
        count: int = camera.statistics["substeps"] + len(packet) + packet.watermark_ns
        aps: esaac.ApsFrame | None = camera.aps
        camera.voxel_grid(bins=5)
        state: bytes = camera.save()
        camera.restore(state)
    rig = esaac.Rig([sensor, "dvs128"])
    packets: list[esaac.Packet] = rig.step([(frame, None), None], [0, None])
    tiled = esaac.TiledEventCamera("dvs128", 64, width=64, height=64)
    tiled.reset([1, 2])
    with esaac.EventWriter("events.npz", sensor) as events:
        events.write(packets[0])
    uses: list[int] = [entry["bytes"] for entry in rig.memory()]
    cuda: int | None = esaac.devices()[0]["cuda"]
    try:
        esaac.SensorModel(substeps=65)
    except esaac.SensorError as error:
        print(error.parameter, error.expected, error.actual, rate, names, count, aps, uses, cuda)
