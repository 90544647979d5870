"""Note on a training at the top of a page; empty if no training is followed."""

import viser


class Note:
    """Note of one browser."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._folder = gui.add_folder("Training", visible=False)
        with self._folder:
            self.words = gui.add_markdown("")

    def say(self, text: str) -> None:
        """Markdown."""
        if text != self.words.content:
            self.words.content = text
            self._folder.visible = bool(text)
