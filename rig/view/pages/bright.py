"""Light over the picture of a browser on an HDR screen: an AVIF that goes above white."""

import base64

import viser

from imaging.arrays import Array32
from imaging.files.hdr_display import encode_avif
from rig.view.serving.window import BRIGHT


class Bright:
    """An element whose data the page's script (`rig.view.serving.window`) lays over the canvas."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._element, self._count = gui.add_html(""), 0

    def show(self, light: Array32) -> None:
        """Lay linear Rec.709 [H, W, 3] over the picture, 1 as white."""
        data = base64.b64encode(encode_avif(light)).decode()
        self._count += 1
        content = f'<span id="{BRIGHT}" data-number="{self._count}" data-avif="{data}" hidden></span>'
        self._element.content = content

    def clear(self) -> None:
        """Show the picture itself."""
        if self._element.content:
            self._element.content = ""
