"""Isaac Sim 6 draws a camera at a rate of its own, `omni:sensor:tickRate` in frames a second; 0 is every frame.

In between it may hand out the last image with the time of now, from which events would come in bursts.
"""

from pxr import Usd

ATTRIBUTE = "omni:sensor:tickRate"


class EveryFrame:
    """Lets cameras of a stage be drawn at every frame until `restore`. The stage's own layers stay as they are."""

    def __init__(self, stage, paths):
        self._layer, self._before = stage.GetSessionLayer(), {}
        with Usd.EditContext(stage, Usd.EditTarget(self._layer)):
            for path in paths:
                attribute = stage.GetPrimAtPath(path).GetAttribute(ATTRIBUTE)
                if not attribute or not attribute.Get():
                    continue
                own = self._layer.GetAttributeAtPath(attribute.GetPath())
                self._before[attribute.GetPath()] = own.default if own else None
                attribute.Set(0.0)

    def restore(self):
        """What the session's layer said before holds again."""
        for path, value in self._before.items():
            own = self._layer.GetAttributeAtPath(path)
            if own and value is None:
                own.owner.RemoveProperty(own)
            elif own:
                own.default = value
        self._layer.RemoveInertSceneDescription()
        self._before = {}
