"""Renders pictures of models/raven2/raven2.xml in its home pose.

`MUJOCO_GL=egl python analysis/looks/render.py FOLDER` writes one PNG per camera, and raven2.png for
the README: the theatre with the close-up in a corner.
"""

import sys
from pathlib import Path

import mujoco
from PIL import Image, ImageOps

MODEL = Path(__file__).resolve().parents[2] / "models" / "raven2" / "raven2.xml"


def views(model: mujoco.MjModel, width: int, height: int) -> dict[str, Image.Image]:
    """Return one picture per camera of the model, in the pose of key "home", rendered at twice the
    size for smooth edges.
    """
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    mujoco.mj_forward(model, data)
    pictures = {}
    with mujoco.Renderer(model, 2 * height, 2 * width) as renderer:
        for camera in range(model.ncam):
            renderer.update_scene(data, camera)
            image = Image.fromarray(renderer.render())
            pictures[model.camera(camera).name] = image.resize(
                (width, height), Image.Resampling.LANCZOS
            )
    return pictures


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    pictures = views(mujoco.MjModel.from_xml_path(str(MODEL)), 1200, 780)
    for name, picture in pictures.items():
        picture.save(folder / f"{name}.png")
    whole = pictures["theatre"].copy()
    inset = ImageOps.expand(
        pictures["closeup"]
        .crop((200, 130, 1000, 650))
        .resize((372, 242), Image.Resampling.LANCZOS),
        3,
        "white",
    )
    whole.paste(inset, (whole.width - inset.width - 18, 18))
    whole = whole.resize((960, 624), Image.Resampling.LANCZOS).point(
        lambda level: level & 0xFE
    )  # halves the file size
    whole.save(folder / "raven2.png", optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
