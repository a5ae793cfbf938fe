"""Turns a stage's camera around the origin, step by step, and renders each after the edit.

    python examples/python/edit_and_rerender.py STAGE OUTPUT [FRAMES]

OUTPUT holds one `%d`, such as turn.%d.png. Only the camera changes, so that only the camera is read again.
"""

import sys

import encore
from pxr import Gf, Usd, UsdGeom


def main(stage_path: str, output: str, frames: int = 4) -> None:
    stage = Usd.Stage.Open(stage_path)
    with encore.Renderer(stage, width=240, samples=3) as renderer:
        first = renderer.render()
        if not first.camera:
            raise SystemExit(f"{stage_path} has no camera")
        camera = UsdGeom.Xformable(stage.GetPrimAtPath(first.camera))
        start = camera.GetLocalTransformation()
        up = Gf.Vec3d.YAxis() if UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.y else Gf.Vec3d.ZAxis()
        # Edits go to the session layer: the file stays as it is.
        stage.SetEditTarget(stage.GetSessionLayer())
        for frame in range(frames):
            turn = Gf.Matrix4d().SetRotate(Gf.Rotation(up, 360 * frame / frames))
            camera.MakeMatrixXform().Set(start * turn)
            image = renderer.render()
            image.save(output % frame)
            seconds = image.statistics["time_s"]
            print(f"{output % frame}: {seconds['total']:.2f} s, reading the stage {seconds['sync']:.3f} s")


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], *(int(count) for count in sys.argv[3:4]))
