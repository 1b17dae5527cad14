"""A program that uses every name of `esaac.__all__`, for a type checker; it is not run. Not every method and property
of its classes is used, and `esaac.ros`, `files` and `still` only in part."""

import warnings

import numpy as np

import esaac
from esaac import ros


def use() -> None:
    for kind in (esaac.InputWarning, esaac.LightWarning, esaac.PoseWarning, esaac.SynthesisWarning):
        warnings.simplefilter("ignore", kind)
    lux: float = esaac.lux_per_unit("radiance", 2.0, efficacy_lm_per_w=100.0)
    sensor = esaac.SensorModel("davis346", profile="noisy", contrast_on=0.2, lux_per_unit=lux)
    rate: float = sensor.replace(seed=7).leak_rate_hz
    names: list[str] = [name for name, _, _ in esaac.SensorModel.parameters()]
    frame = np.zeros((260, 346, 4), np.float32)
    with esaac.EventCamera(sensor, device="cuda:0", packets="cuda") as camera:
        packet: esaac.Packet = camera.step(frame, t_ns=0, depth=None)
        synthesis: str | None = camera.synthesis
        camera.sensor = sensor
        count: int = camera.statistics["substeps"] + len(packet) + packet.watermark_ns
        aps: esaac.ApsFrame | None = camera.aps
        last: esaac.Packet | None = camera.last_packet
        grid: esaac.Tensor = camera.voxel_grid(bins=5)
        with esaac.EventWriter("events.npz", sensor) as events:
            events.write(packet, camera.event_ids())
        state: bytes = camera.save()
        camera.restore(state)
    part: esaac.files.Events = esaac.files.load("events.h5", from_ns=0, to_ns=1000)
    if part.ids is not None and part.sensor is not None:
        esaac.files.save("part.npz", part.x, part.y, part.t_ns, part.p, ids=part.ids, sensor=part.sensor)
    size_px: tuple[int, int] | None = part.size_px
    count += len(size_px or ()) + len(part) + len(esaac.files.load_dsec("events.h5")[0])
    lens = esaac.Intrinsics.from_matrix(np.eye(3), half_pixel_centres=True)
    times_ns, places = np.array([0, 1]), np.zeros((2, 7))
    poses = esaac.Poses(times_ns, places, places[:, None], ids={1: 0, 2: None}, order="wxyz", axes="ros")
    displaced = esaac.flow(frame[..., 0], intrinsics=lens, poses=poses, from_ns=0, to_ns=1)
    count += int(displaced.shape[0])
    recorder = esaac.PoseRecorder(ids=[0, 1], limit=100)
    recorder.record(0, places[0], places)
    recorder.clear()
    rigid = esaac.EventCamera(sensor, intrinsics=lens, synthesis="rigid")
    rigid.step(
        frame, t_ns=0, depth=frame[..., 0] / lens.ray_lengths(346, 260), ids=frame[..., 0], poses=recorder
    )
    esaac.Rig([sensor], intrinsics=[(1, 1, 0, 0)]).step([(frame, None, frame)], 0, poses=[poses])
    rig = esaac.Rig([sensor, "dvs128"])
    packets: list[esaac.Packet] = rig.step([(frame, None), None], [0, None]) or rig.last_packets
    tiled = esaac.TiledEventCamera("dvs128", 64, packets="mapped", packet_ring=3, width=64, height=64)
    tiled.reset([1, 2])
    tiled.reset(np.ones(64, np.bool_))
    rig.reset(1)
    with esaac.EventWriter("events.npz", sensor) as events:
        events.write(packets[0])
    told = ros.Camera(
        "davis", sensor, focal_px=300.0, rgb=True, depth=True, imu=True, frame_id="sim_camera", event_ids=True
    )
    with ros.Publisher([told], events="evt3", qos={"all": "best_effort"}, record="run.mcap") as publisher:
        sample = ros.Imu(0, (0.0, 0.0, 0.1), (0.0, 0.0, 9.81))
        publisher.publish(0, {"davis": ros.Frame(packet, aps, frame, frame, [sample], camera.event_ids())})
        publisher.set_instances("davis", {1: ros.Instance("/box", {"class": ["box"]}), 2: "/wall"})
        publisher.set_sensor("davis", sensor)
        publisher.set_status("davis", camera.statistics, camera.light_warnings[0])
        lines: list[str] = publisher.notices() + list(publisher.topics)
    path = esaac.still.CameraPath.read("transforms.json", dataparser="dataparser_transforms.json")
    still = esaac.EventCamera(sensor, intrinsics=path.lens, width=path.width, height=path.height)
    depth = esaac.still.visible_depth(frame[..., 0], opacity=frame[..., 1], rays_of=path.lens)
    still.step(frame, t_ns=0, depth=depth, poses=path.poses(times_ns))
    views = esaac.still.view_of(path.world_from_camera) - path.views()
    esaac.Poses.from_matrices(times_ns, views, axes="opencv", ids=[0])
    camera.step(esaac.CudaTexture(1, 346, 260, mipmapped=False), t_ns=1)
    uses: list[int] = [entry["bytes"] for entry in rig.memory()]
    cuda: int | None = esaac.devices()[0]["cuda"]
    try:
        esaac.SensorModel(substeps=65)
    except (esaac.ArgumentError, esaac.FrameError, esaac.ClosedError, esaac.ForkError) as error:
        print(error, esaac.__version__, grid.shape)
    except (esaac.DeviceError, esaac.RosError):
        raise
    except esaac.SensorError as error:
        print(
            error.parameter,
            error.expected,
            error.actual,
            rate,
            names,
            count,
            aps,
            uses,
            cuda,
            lines,
            last,
            synthesis,
        )
    except esaac.EsaacError as error:
        print(error)
