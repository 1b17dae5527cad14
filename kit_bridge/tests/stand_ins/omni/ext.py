"""Kit instantiates subclasses of `IExt` and calls `on_startup(ext_id)`."""


class IExt:
    pass
