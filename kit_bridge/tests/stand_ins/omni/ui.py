"""Widgets that hold what they are told, nested by `with`; a value model calls back when an edit ends."""

WINDOWS = []
BUTTONS = []
SLIDERS = []


def reset():
    """Forgets the widgets of earlier tests."""
    WINDOWS.clear(), BUTTONS.clear(), SLIDERS.clear()


class _Widget:
    def __init__(self, text="", **parameters):
        self.text, self.parameters, self.visible = text, parameters, True
        self.destroyed = False

    def __enter__(self):
        return self

    def __exit__(self, *_):
        return False

    def clear(self):
        pass

    def destroy(self):
        self.destroyed = True


class Label(_Widget):
    pass


class Button(_Widget):
    def __init__(self, text="", **parameters):
        super().__init__(text, **parameters)
        BUTTONS.append(self)

    def click(self):
        self.parameters["clicked_fn"]()


class HStack(_Widget):
    pass


class VStack(_Widget):
    pass


class ScrollingFrame(_Widget):
    pass


class CollapsableFrame(_Widget):
    pass


class ImageWithProvider(_Widget):
    pass


class Window(_Widget):
    def __init__(self, title, **parameters):
        super().__init__(title, **parameters)
        self.frame = _Widget()
        WINDOWS.append(self)


class ByteImageProvider:
    data = None

    def set_bytes_data(self, data, size):
        assert len(data) == 4 * size[0] * size[1]
        self.data = data


class _Model:
    def __init__(self):
        self.value, self._calls = 0, []

    def set_value(self, value):
        self.value = value

    def get_value_as_int(self):
        return int(self.value)

    def get_value_as_float(self):
        return float(self.value)

    def add_end_edit_fn(self, call):
        self._calls.append(call)

    def edit(self, value):
        self.value = value
        for call in self._calls:
            call(self)


class _Slider(_Widget):
    def __init__(self, **parameters):
        super().__init__(**parameters)
        self.model = _Model()
        SLIDERS.append(self)


class IntSlider(_Slider):
    pass


class FloatSlider(_Slider):
    pass
