"""Controls beside the picture of a scene: sliders, choices, switches."""

from collections.abc import Callable
from typing import Any

import viser

from rig.view.pages.bright import Bright
from rig.view.pages.note import Note
from rig.view.pictures.layers import LAYERS, legend_of
from rig.view.pictures.look import TONE_MAPS, Look, band_legend, legend
from rig.view.pictures.painter import DIFFERENCE, OVER, Painter, Parts, compared_with
from rig.view.serving.window import Window

FREE = "free"
AIM = "Click or tap into the picture."
DIFFERENCE_STOPS = 2.0
"""Range of the colours of a difference, stops."""
KEYS = (
    "Drag or arrow keys to turn, right-drag to shift, scroll to go nearer, **W A S D Q E** to fly.  \n"
    "**B**, **V**: a stop brighter, darker. **N**, **P**: next, previous photograph. "
    "**C**: cameras. **H**: home. Click or tap to measure."
)
FULL_SCREEN = (
    '<div style="padding:0 1em 0.6em"><button style="width:100%;padding:0.35em;border-radius:4px;border:1px '
    'solid #8886;background:none;color:inherit;cursor:pointer" onclick="document.fullscreenElement ? '
    'document.exitFullscreen() : document.documentElement.requestFullscreen()">Full screen</button></div>'
)


class Controls:
    """The controls of one browser, as a look has them; `changed` is called after what concerns the picture.

    window: a narrow one begins with some folded, and one on an HDR screen with that switched on.
    """

    def __init__(
        self,
        gui: viser.GuiApi,
        painter: Painter,
        look: Look,
        changed: Callable[[], None],
        *,
        window: Window,
        on_view: Callable[[str], None],
        on_pixels: Callable[[bool], None],
        on_frusta: Callable[[bool], None],
        on_home: Callable[[], None],
    ) -> None:
        self._painter, self._on_home = painter, on_home
        scene = painter.scene
        self.note = Note(gui)
        with gui.add_folder("Look"):
            hint = "At 0 the median of the scene is middle grey."
            self.exposure = gui.add_slider("Exposure, stops", -16.0, 16.0, 0.1, look.exposure, hint=hint)
            hint = "linear: clipped at white, else untouched. The others bring more light onto the screen."
            self.tones = gui.add_dropdown("Tones", TONE_MAPS, initial_value=look.tones, hint=hint)
            hint = (
                "A picture at rest shows light above white, as far as the screen can, in place of the tones."
            )
            bright = window.bright and look.tones == "AgX"
            self.hdr = gui.add_checkbox("HDR", bright, visible=window.bright, hint=hint)
            self.legend = gui.add_image(legend(), visible=False)
        with gui.add_folder("Cameras", expand_by_default=not window.narrow):
            self.view = gui.add_dropdown("View", (FREE, *(view.name for view in scene.views)))
            shows = painter.shows(None)
            self.show = gui.add_dropdown("Show", shows, visible=len(shows) > 1)
            hint = "A pixel of the photograph in one of the screen; a click brings a place to the middle."
            self.pixels = gui.add_checkbox("1:1", False, visible=False, hint=hint)
            self.frusta = gui.add_checkbox("Photographs", False, hint="Their cameras, in the scene.")
            self.home = gui.add_button("Home", icon=viser.Icon.HOME, hint="Back to where the page began.")
        self.parts_of_model = self._parts(gui, painter, changed, window.narrow)
        with gui.add_folder("Spot meter"):
            self.spot = gui.add_markdown(AIM)
        with gui.add_folder("Keys", expand_by_default=False):
            gui.add_markdown(KEYS)
        gui.add_html(FULL_SCREEN)
        self.state, self.bright = gui.add_html(""), Bright(gui)
        self._hotkeys(gui)
        self.say_legend()
        self.exposure.on_update(lambda _: changed())
        self.tones.on_update(lambda _: self._retone(changed))
        self.hdr.on_update(lambda _: changed())
        self.show.on_update(lambda _: self._retone(changed))
        self.view.on_update(lambda _: on_view(self.view.value))
        self.pixels.on_update(lambda _: on_pixels(self.pixels.value))
        self.frusta.on_update(lambda _: on_frusta(self.frusta.value))
        self.home.on_click(lambda _: on_home())

    @property
    def look(self) -> Look:
        """Chosen look."""
        return Look(float(self.exposure.value), self.tones.value)

    @property
    def parts(self) -> Parts:
        """Chosen parts."""
        environment, degree = self.parts_of_model
        return Parts(environment is None or environment.value, None if degree is None else int(degree.value))

    def offer(self, view: str | None) -> None:
        """Offer the layers of a view for choice."""
        shows = self._painter.shows(view)
        if tuple(self.show.options) != shows:
            chosen = self.show.value
            self.show.options = shows
            assign(self.show, chosen if chosen in shows else shows[0])
        self.show.visible = len(shows) > 1
        self.pixels.visible = view is not None

    def _hotkeys(self, gui: viser.GuiApi) -> None:
        def stop(more: float) -> None:
            assign(self.exposure, min(max(self.exposure.value + more, -16.0), 16.0))

        def step(by: int) -> None:
            names = self.view.options[1:]  # behind FREE, from which the next is the first
            here = names.index(self.view.value) if self.view.value != FREE else min(-by, 0)
            assign(self.view, names[(here + by) % len(names)])

        gui.add_command("Brighter by a stop", hotkey="B").on_trigger(lambda _: stop(1.0))
        gui.add_command("Darker by a stop", hotkey="V").on_trigger(lambda _: stop(-1.0))
        gui.add_command("Next photograph", hotkey="N").on_trigger(lambda _: step(1))
        gui.add_command("Previous photograph", hotkey="P").on_trigger(lambda _: step(-1))
        gui.add_command("Home", hotkey="H").on_trigger(lambda _: self._on_home())
        cameras = gui.add_command("Cameras of the photographs", hotkey="C")
        cameras.on_trigger(lambda _: assign(self.frusta, not self.frusta.value))

    def _retone(self, changed: Callable[[], None]) -> None:
        self.say_legend()
        changed()

    def say_legend(self) -> None:
        """Show the legend of the colours, if any."""
        show = str(self.show.value)
        label, picture = "", legend()
        if show in LAYERS:
            label = legend_of(show, self._painter.scene)
        elif show in (DIFFERENCE, OVER):
            ours = "B" if show == OVER else "render"
            label = f"{ours} over {compared_with(show)}: -{DIFFERENCE_STOPS:g} to +{DIFFERENCE_STOPS:g} stops"
        elif self.tones.value == "false colour":
            label = "stops above middle grey, a colour each"
            picture = band_legend()
        self.legend.image = picture
        self.legend.visible = bool(label)
        self.legend.label = label or None

    @staticmethod
    def _parts(
        gui: viser.GuiApi, painter: Painter, changed: Callable[[], None], narrow: bool
    ) -> tuple[Any, Any]:
        """Switches for the parts that the scenes have; None where they have none of a kind."""
        far = any(scene.renderer.environment is not None for scene in painter.scenes)
        degree = max(scene.record.degree for scene in painter.scenes)
        environment = harmonics = None
        if far or degree:
            with gui.add_folder("Model", expand_by_default=not narrow):
                if far:
                    hint = "Light from behind all Gaussians, by direction alone."
                    environment = gui.add_checkbox("Light from far away", True, hint=hint)
                    environment.on_update(lambda _: changed())
                if degree:
                    hint = "Degree of the harmonics: at 0 colours are the same from everywhere."
                    harmonics = gui.add_slider("Colours by direction", 0, degree, 1, degree, hint=hint)
                    harmonics.on_update(lambda _: changed())
        return environment, harmonics


def assign(control: Any, value: object) -> None:
    """Set a control, and the browser's: viser annotates values as if they could only be read."""
    control.value = value
