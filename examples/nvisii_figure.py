"""The smallest NViSII script: a camera, a sphere, a light, a picture."""

import nvisii

nvisii.initialize(headless=True)

camera = nvisii.entity.create(
    name="camera",
    transform=nvisii.transform.create("camera_transform"),
    camera=nvisii.camera.create("camera_camera", aspect=1.0),
)
camera.get_transform().look_at(eye=[0, -4, 1.5], at=[0, 0, 0], up=[0, 0, 1])
nvisii.set_camera_entity(camera)

sphere = nvisii.entity.create(
    name="sphere",
    mesh=nvisii.mesh.create_sphere("sphere_mesh"),
    transform=nvisii.transform.create("sphere_transform"),
    material=nvisii.material.create("sphere_material"),
)
sphere.get_material().set_base_color([0.1, 0.4, 0.8])
sphere.get_material().set_roughness(0.3)

light = nvisii.entity.create(
    name="light",
    mesh=nvisii.mesh.create_sphere("light_mesh", radius=0.3),
    transform=nvisii.transform.create("light_transform", position=[2, -2, 3]),
    light=nvisii.light.create("light_light"),
)
light.get_light().set_temperature(4500)
light.get_light().set_intensity(60)

nvisii.render_to_file(width=512, height=512, samples_per_pixel=1024, file_path="image.png")
nvisii.deinitialize()
