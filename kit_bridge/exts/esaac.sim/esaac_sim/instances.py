"""Which prim each id of an image is: one id for each prim, in all frames and for all cameras of a stage.

Kit counts what a frame shows. When prims come, go or are hidden, a number may mean another prim than in the frame
before. But events are made of two frames, and a recording has one table of ids. So a prim keeps the number that it
had when it was first seen, or gets a free one if that was another prim's. Images that have it under another number
are renumbered.
"""

import itertools

from .semantics import semantics_of

BACKGROUND = 0


class Instances:
    """The prims of a stage that cameras have seen, and their ids."""

    def __init__(self, stage):
        self._stage = stage
        self._ids, self._labels = {}, {BACKGROUND: "BACKGROUND"}
        self._numbers = itertools.count(1)

    def settle(self, ids, labels):
        """An image of Kit's ids and its `idToLabels`, both with the ids of this stage. Only an image in which some id
        differs is copied."""
        settled, changes = {}, {}
        for name, label in labels.items():
            theirs = int(name)
            ours = BACKGROUND if theirs == BACKGROUND else self._id_of(str(label), theirs)
            settled[ours] = str(label)
            if ours != theirs:
                changes[theirs] = ours
        if changes:
            # Warp takes seconds to load, and most stages do without.
            from .renumber import renumbered

            ids = renumbered(ids, changes)
        return ids, settled

    def described(self, number):
        """The prim of an id and its semantic labels, as they are now; None for what is no prim."""
        label = self._labels[number]
        if not label.startswith("/"):
            return None
        return {"prim": label, "semantics": semantics_of(self._stage.GetPrimAtPath(label))}

    def _id_of(self, label, wanted):
        if label not in self._ids:
            free = (number for number in self._numbers if number not in self._labels)
            number = wanted if wanted not in self._labels else next(free)
            self._ids[label], self._labels[number] = number, label
        return self._ids[label]
