"""A robot in MuJoCo's viewer, or as a picture."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from truepose.exceptions import InputError, TrueposeError
from truepose.files import Output, check, mark, replace_file, unfinished
from truepose.robot import Robot
from truepose_mujoco.mjcf import Model

_PATIENCE = 120  # timeout of one picture, s


def show(robot: Robot) -> None:
    """Open MuJoCo's viewer on the robot at home, motors held; return when it is closed.

    TrueposeError: there is no screen.
    """
    screen = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if sys.platform.startswith("linux") and not screen:
        raise TrueposeError(f"{robot.name}: there is no screen here; --png FILE draws a picture")
    from mujoco import viewer

    from truepose_mujoco.body import Body

    body = Body(robot)
    body.hold()
    viewer.launch(body.model, body.data)


def picture(robot: Robot, path: Path, *, force: bool = False) -> None:
    """Draw the robot at home into a PNG file. Needs no screen.

    InputError: the file exists (`force` replaces it) or cannot be written. TrueposeError:
    no OpenGL driver works.
    """
    if path.suffix.lower() != ".png":
        raise InputError(f"{path}: must end in .png")
    check([Output(path, "picture")], force=force)
    drivers = (os.environ.get("MUJOCO_GL") or "egl osmesa glfw").split()  # the last needs a screen
    with unfinished(Path(tempfile.mkdtemp())) as folder:
        model, png = folder / "robot.xml", folder / "robot.png"
        model.write_text(Model(robot).xml(), encoding="utf-8")
        for driver in drivers:
            try:  # in a process of its own, because a broken driver may crash it
                subprocess.run(
                    [sys.executable, "-m", __name__, str(model), str(png)],
                    env=os.environ | {"MUJOCO_GL": driver},
                    capture_output=True,
                    timeout=_PATIENCE,
                    cwd=folder,
                    check=True,
                )
            except (subprocess.SubprocessError, OSError):
                continue
            replace_file(path, png.read_bytes(), "picture", force)
            return
    raise TrueposeError(
        f"no OpenGL driver works (MUJOCO_GL: {', '.join(drivers)}): install libegl1 and "
        "libgl1-mesa-dri, or libosmesa6 (Debian's names)"
    )


def _draw(model_file: str, png: str) -> None:
    """Draw one picture with the driver in MUJOCO_GL."""
    import mujoco
    from matplotlib.image import imsave

    model = mujoco.MjModel.from_xml_path(model_file)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with mujoco.Renderer(model, 1200, 1600) as renderer:
        renderer.update_scene(data)
        imsave(png, renderer.render(), metadata={"Software": mark("picture")})


if __name__ == "__main__":
    _draw(*sys.argv[1:])
