"""A substitute for the gui of the page: added elements are found by their labels and can be operated."""

from contextlib import nullcontext
from types import SimpleNamespace


class Handle:
    """An element of the page: its kind, choices and value; ``use`` is a click or a choice of a user."""

    def __init__(self, kind, label, options=(), value=None, **more):
        self.kind, self.label, self.options, self.value, self.more = kind, label, tuple(options), value, more
        self.content, self.visible, self.hint, self.callbacks = '', True, '', []

    def on_click(self, callback):
        self.callbacks.append(callback)

    on_update = on_upload = on_click

    def on_hold(self, callback, callback_hz):
        self.callbacks.append(callback)
        self.more['hz'] = callback_hz

    def use(self, value=None):
        """Choose a value, if one is given, and return the results of the callbacks."""
        if value is not None:
            self.value = value
        return [one(SimpleNamespace(client='somebody', target=self)) for one in self.callbacks]

    def remove(self):
        """Vanish."""


class Gui:
    """Elements by their labels; tabs and folders do not count."""

    def __init__(self):
        self.things = {}

    def __getitem__(self, label):
        return self.things[label]

    def _add(self, kind, label, options=(), value=None, **more):
        handle = Handle(kind, label, options, value, **more)
        self.things[label] = handle
        return handle

    def add_button(self, label, **more):
        return self._add('button', label, **more)

    def add_upload_button(self, label, **more):
        return self._add('upload', label, **more)

    def add_button_group(self, label, options, **more):
        return self._add('group', label, options, **more)

    def add_dropdown(self, label, options, initial_value=None, **more):
        return self._add('dropdown', label, options, initial_value or next(iter(options)), **more)

    def add_checkbox(self, label, initial_value, **more):
        return self._add('checkbox', label, (), initial_value, **more)

    def add_text(self, label, initial_value, visible=True, **more):
        return self._add('text', label, (), initial_value, **more)

    def add_number(self, label, initial_value, visible=True, **more):
        return self._add('number', label, (), initial_value, **more)

    def add_slider(self, label, low, high, step, initial_value, **more):
        return self._add('slider', label, (low, high, step), initial_value, **more)

    def add_html(self, content, **more):
        return Handle('html', '')

    add_markdown = add_html

    def add_tab_group(self):
        return SimpleNamespace(add_tab=lambda _: nullcontext())

    def add_folder(self, *_, **more):
        return nullcontext()
