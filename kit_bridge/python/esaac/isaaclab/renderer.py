"""Newton Warp, which draws for event cameras too."""

from isaaclab_newton.renderers.newton_warp_renderer import NewtonWarpRenderer

from esaac.errors import ArgumentError


class EventRenderer(NewtonWarpRenderer):
    """What Isaac Lab calls to draw. The camera gives its `View` as `render_data.view`; other cameras have none."""

    def create_render_data(self, spec):
        data = super().create_render_data(spec)
        data.view = data.averaged = None
        data.draws_images = True
        return data

    def set_outputs(self, render_data, output_data):
        images = dict(output_data)
        if render_data.view is not None:
            # Its colour is the averaged one.
            hdr = images.pop("rgb_hdr", None)
            render_data.averaged = None if hdr is None else hdr.warp
            render_data.draws_images = bool(images)
        super().set_outputs(render_data, images)

    def update_camera_intrinsics(self, render_data, intrinsics, parameters):
        if getattr(render_data, "view", None) is not None:
            raise ArgumentError(
                "an event camera's lens is changed while it runs, expected it to stay; set it in the camera's "
                "`spawn` (PinholeCameraCfg.from_intrinsic_matrix)"
            )
        super().update_camera_intrinsics(render_data, intrinsics, parameters)

    def _launch_render(self, render_data):
        # On a GPU this is captured as a graph: it allocates nothing.
        if render_data.draws_images:
            super()._launch_render(render_data)
        if render_data.view is None:
            return
        # All cameras of a model share this configuration.
        far = self.cfg.max_distance if render_data.far_clip is None else render_data.far_clip
        self.newton_sensor.default_render_config.max_distance = far
        render_data.view.draw(
            self.newton_sensor, self.backend.state_0, render_data.camera_transforms, render_data.averaged
        )
