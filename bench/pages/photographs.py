"""docs/photographs.jpg: held-out photographs of a scene, and beside each what the scene makes of it.

    rig import $RIG_DATA/banana S && rig calibrate S && rig reconstruct S --quality draft --set width=480
    python -m bench.pages.photographs S

The photographs are pierotofy's dataset_banana (MIT).
"""

import argparse
from pathlib import Path

from PIL import Image

from imaging.session.paths import find_reconstruction

PICTURE = Path(__file__).parents[2] / "docs" / "photographs.jpg"
MOST, GAP, JPEG_QUALITY = 2, 8, 90


def beside_each_other(scene: Path) -> Image.Image:
    """A row a view: the photograph, and the render of the scene, from what `rig evaluate` wrote."""
    files = sorted((scene / "references").glob("*.png"))[:MOST]
    rows = [[Image.open(path), Image.open(scene / "renders" / path.name)] for path in files]
    width, height = rows[0][0].size
    size = (2 * width + GAP, len(rows) * (height + GAP) - GAP)
    picture = Image.new("RGB", size, "white")
    for row, pair in enumerate(rows):
        for column, part in enumerate(pair):
            picture.paste(part.convert("RGB"), (column * (width + GAP), row * (height + GAP)))
    return picture


def main() -> None:
    """Write the picture of a session's newest scene."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("session", type=Path)
    picture = beside_each_other(find_reconstruction(parser.parse_args().session))
    picture.save(PICTURE, quality=JPEG_QUALITY, optimize=True)


if __name__ == "__main__":
    main()
