"""Run by Kit's own test runner: a stage with a moving cube, an event camera, events."""

import omni.kit.app
import omni.kit.test
import omni.timeline
import omni.usd
from pxr import Gf, Sdf, UsdGeom, UsdLux

from esaac_sim import Bridge
from esaac_sim.extension import Log


class TestExtension(omni.kit.test.AsyncTestCase):
    async def setUp(self):
        await omni.usd.get_context().new_stage_async()
        self.stage = omni.usd.get_context().get_stage()
        UsdLux.DomeLight.Define(self.stage, "/light").CreateIntensityAttr(500.0)
        self.cube = UsdGeom.Cube.Define(self.stage, "/cube").AddTranslateOp()
        camera = UsdGeom.Camera.Define(self.stage, "/camera")
        camera.AddTranslateOp().Set(Gf.Vec3d(0, 0, 8))
        camera.GetPrim().CreateAttribute("esaac:sensor", Sdf.ValueTypeNames.Token).Set("dvs128")

    async def test_the_self_test_passes_and_a_moving_cube_sends_events(self):
        import carb.settings

        app, bridge = omni.kit.app.get_app(), Bridge(carb.settings.get_settings(), Log())
        timeline = omni.timeline.get_timeline_interface()
        self.assertTrue(await bridge.self_test(app, self.stage))
        self.assertTrue(timeline.is_stopped())
        for check in bridge.checks:
            self.assertTrue(check.holds, f"{check.name}: {check.message}")
        self.assertEqual(bridge.attach(self.stage), 1, bridge.problems)
        timeline.play()
        for index in range(60):
            self.cube.Set(Gf.Vec3d(0.02 * index, 0, 0))
            await app.next_update_async()
        feed = bridge.feeds[0]
        self.assertGreater(feed.frames, 10, feed.message)
        self.assertGreater(feed.events, 100, feed.message)
        self.assertEqual(feed.faults, 0, feed.message)
        bridge.detach()
        timeline.stop()
