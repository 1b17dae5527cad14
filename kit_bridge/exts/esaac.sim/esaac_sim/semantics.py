"""Semantic labels of prims, as Isaac Sim and Replicator write them, read without the schemas that declare them."""

LABELS = "semantics:labels:"
"""`semantics:labels:class = ["box"]`: USD's own, in Isaac Sim 5 and later."""

OLD_TYPE, OLD_DATA = ":params:semanticType", ":params:semanticData"
"""`semantic:NAME:params:semanticType = "class"`, `semantic:NAME:params:semanticData = "box"`: earlier."""


def semantics_of(prim):
    """Lists of labels by their kind, such as `{"class": ["box"]}`. A kind that a prim has not is that of its nearest
    ancestor."""
    labels = {}
    while prim:
        labels = {**_own(prim), **labels}
        prim = prim.GetParent()
    return labels


def _own(prim):
    labels = {}
    for attribute in prim.GetAuthoredAttributes():
        name = attribute.GetName()
        if name.startswith(LABELS):
            labels.setdefault(name.removeprefix(LABELS), []).extend(map(str, attribute.Get() or ()))
        elif name.startswith("semantic:") and name.endswith(OLD_TYPE):
            data = prim.GetAttribute(name.removesuffix(OLD_TYPE) + OLD_DATA)
            if data and data.Get():
                labels.setdefault(str(attribute.Get()), []).append(str(data.Get()))
    return labels
