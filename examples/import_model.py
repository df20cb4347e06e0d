"""Imports a glTF model, prints its contents, changes a material, and saves the scene.

usage: import_model.py [OUT_DIR] [MODEL]
"""

import sys
from pathlib import Path

import heliograph as hg
from heliograph import framing

MODEL = Path(__file__).parent / "assets/FlightHelmet/FlightHelmet.gltf"


def main(out: Path, model: Path) -> None:
    out.mkdir(parents=True, exist_ok=True)
    with hg.connect() as client, client.create_scene("import") as scene:
        with scene.edit() as edit:
            edit.sample_studio()
            asset = edit.import_file(model, name="model", category="thing")
        print(f"materials: {', '.join(asset.materials)}")
        print(f"animations: {', '.join(asset.animations) or 'none'}")
        for warning in asset.warnings:
            print(f"warning: {warning}")
        first = next(iter(asset.materials.values()))
        with scene.edit() as edit:
            material = edit.material(None, base_color=(0.5, 0.05, 0.03), roughness=0.3)
            size = asset.bounds[1] - asset.bounds[0]
            beside = hg.Pose((1.2 * float(size[0]), 0, 0))
            edit.instance(
                asset, "red", transform=beside, materials={list(asset.materials)[0]: material}
            )
            lens = hg.Camera.from_fov(35, 640, 360, degrees=True)
            bounds = asset.bounds.copy()
            bounds[1, 0] += beside.position[0]
            edit.entity("cam", camera=lens, transform=framing.frame_box(bounds, lens, azimuth=20))
        print(f"{first!r} is {first.parameters}")
        frame = scene.render("cam", spp=48)
        frame.save(out / "import_model.png", exposure="auto", view="agx")
        scene.save(out / "import_model.helio")
        with client.load_scene(out / "import_model.helio") as again:
            print(f"saved and loaded: {len(again.find('*'))} objects")


if __name__ == "__main__":
    main(
        Path(sys.argv[1] if len(sys.argv) > 1 else "out"),
        Path(sys.argv[2]) if len(sys.argv) > 2 else MODEL,
    )
