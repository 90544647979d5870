"""The first moments of a page, before there is a scene."""

from rig.view.serving.server import Viewer

WATCH = """
window.foreign = new Set();
const look = () => {
  for (const one of document.querySelectorAll("label, button, p, div")) {
    const words = one.childElementCount ? "" : one.textContent.trim();
    if (/^(Dev Settings|Scene tree|Orbit Origin Tool|Save Canvas)$/.test(words)
        && one.checkVisibility({ visibilityProperty: true }) && one.getBoundingClientRect().height > 0)
      foreign.add(words);
  }
  const bare = document.body && getComputedStyle(document.body).backgroundColor;
  if (bare === "rgb(255, 255, 255)") foreign.add(bare);
  requestAnimationFrame(look);
};
requestAnimationFrame(look);
"""


def test_while_it_opens_a_page_has_our_own_names_alone(browser) -> None:
    with Viewer("my scene", 0) as viewer:
        tab = browser.new_page(viewport={"width": 900, "height": 500})
        tab.add_init_script(WATCH)
        tab.goto(viewer.url)
        tab.get_by_text("Opening the scene", exact=True).wait_for()
        tab.get_by_text("my scene", exact=True).wait_for()
        tab.wait_for_timeout(700)
        assert tab.get_by_text("my scene", exact=True).is_visible()
        assert tab.evaluate("[...foreign]") == []
        tab.close()
