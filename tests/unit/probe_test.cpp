// Every centre plane on scenes whose values are known in closed form.
#include "kernels/label/probe.h"

#include "tests/unit/catch.h"
#include "tests/unit/test_tracer.h"

using namespace heliograph::test;

namespace {

constexpr uvec2 kSize(48, 32);

MaterialView painted() {
  MaterialView m = standard_material();
  m.constant.base_color = vec3(0.2f, 0.4f, 0.6f);
  m.constant.roughness = 0.3f;
  m.constant.metallic = 0.25f;
  m.constant.transmission = 0.125f;
  m.constant.emission = vec3(1, 2, 3);
  m.constant.emission_strength = 2;
  return m;
}

/// A plane z = 0 of 8 x 8 m and a sphere of radius 1 at `center`.
struct World {
  explicit World(vec3 center, mat3 turn = mat3(1)) {
    scene.add_instance(scene.add(rectangle(4, 4)), scene.add(painted()));
    scene.add_instance(scene.add(sphere(128)), scene.add(lambert(vec3(0.5f))), pose(turn, center));
    scene.instances[0].label = 7;
    scene.instances[0].category = 3;
    scene.instances[0].part = 2;
    scene.rest_boxes[0] = {pose(mat3(0.125f, 0, 0, 0, 0.125f, 0, 0, 0, 1), vec3(0.5f, 0.5f, 0.5f)),
                           vec3(std::sqrt(0.5f), std::sqrt(0.5f), 0)};
    scene.instances[1].label = 9;
    scene.instances[1].category = 4;
    scene.instances[1].part = 1;
    scene.rest_boxes[1] = {pose(mat3(0.5f), vec3(0.5f)), vec3(1 / std::sqrt(3.0f))};
    view = &scene.finish();
  }
  TestScene scene;
  const SceneView* view;
};

PlaneSet all_centre() { return planes_of(Fold::kCentre); }

/// Probes every pixel; the other ends of flow may be null.
void probe_all(const ProbeContext& context, const TestFilm& film) {
  const TestTracer now(*context.now.scene);
  const SceneView nothing{};
  const TestTracer forward(context.forward.scene ? context.forward.scene[0] : nothing);
  const TestTracer backward(context.backward.scene ? context.backward.scene[0] : nothing);
  for (u32 y = 0; y < film.view.height; ++y) {
    for (u32 x = 0; x < film.view.width; ++x) {
      probe_pixel(context, now, context.forward.scene ? &forward : nullptr,
                  context.backward.scene ? &backward : nullptr, film.view, x, y);
    }
  }
}

const Settings kSettings = standard_settings(1);

/// The nearest of plane and sphere along a ray, exactly: its distance and whether the sphere is it.
struct Exact {
  double t;
  bool sphere;
};
Exact exact_hit(const Ray& ray, vec3 center) {
  const glm::dvec3 o(ray.origin), d(ray.direction), oc = o - glm::dvec3(center);
  Exact hit{INFINITY, false};
  const double b = dot(oc, d), q = b * b - dot(oc, oc) + 1;
  if (q > 0 && -b - std::sqrt(q) > 0) hit = {-b - std::sqrt(q), true};
  const double t = -o.z / d.z;
  const glm::dvec3 p = o + d * t;
  if (t > 0 && t < hit.t && std::fabs(p.x) < 4 && std::fabs(p.y) < 4) hit = {t, false};
  return hit;
}

}  // namespace

TEST_CASE("probe: geometry, labels and material of a plane and a sphere") {
  const vec3 center(0.5f, -0.3f, 1.2f);
  const World world(center);
  for (const Projection projection : {Projection::kPerspective, Projection::kOrthographic}) {
    CameraView camera = look_at({5, -4, 3.5f}, {0.2f, 0, 0.5f}, kSize, 1.1f);
    camera.lens.projection = projection;
    if (projection == Projection::kOrthographic) camera.fx = camera.fy = 5;
    const TestFilm film(kSize, all_centre());
    probe_all({{world.view, &camera}, {}, {}, nullptr, &kSettings, world.scene.rest_boxes.data()},
              film);
    int seen[3] = {};
    for (u64 i = 0; i < u64(kSize.x) * kSize.y; ++i) {
      const u32 column = i % kSize.x, row = i / kSize.x;
      const vec2 raster(float(column) + 0.5f, float(row) + 0.5f);
      const Ray ray = camera_ray(camera, raster, {0, true});
      const Exact exact = exact_hit(ray, center);
      const u32 label = film.centre<u32>(Plane::INSTANCE, i);
      // On the rim the tessellation decides.
      const vec3 to_center = center - ray.origin;
      const float miss = length(cross(to_center, ray.direction));
      if (std::fabs(miss - 1) < 0.02f) continue;
      const bool hit = std::isfinite(exact.t);
      CHECK(label == (!hit ? 0 : exact.sphere ? 9 : 7));
      CHECK(film.centre<u32>(Plane::SEMANTIC, i) == (!hit ? 0 : exact.sphere ? 4 : 3));
      CHECK(film.centre<u32>(Plane::PART, i) == (!hit ? 0 : exact.sphere ? 1 : 2));
      CHECK(film.centre<u32>(Plane::MATERIAL, i) == (!hit ? kNone : exact.sphere ? 1 : 0));
      ++seen[!hit ? 0 : exact.sphere ? 1 : 2];
      if (!hit) {
        CHECK(film.centre(Plane::DEPTH, i) == INFINITY);
        CHECK(film.centre(Plane::DISTANCE, i) == INFINITY);
        for (const Plane plane :
             {Plane::POSITION, Plane::POSITION_CAMERA, Plane::OBJECT_COORDINATES, Plane::NOCS}) {
          CHECK(std::isnan(at3(film, plane, i).y));
        }
        for (const Plane plane : {Plane::NORMAL, Plane::NORMAL_CAMERA, Plane::GEOMETRIC_NORMAL,
                                  Plane::TANGENT, Plane::BASE_COLOR, Plane::EMISSION}) {
          CHECK(is_black(at3(film, plane, i)));
        }
        CHECK(film.centre<u32>(Plane::PRIMITIVE, i) == kNone);
        CHECK(film.centre(Plane::OPACITY, i) == 0);
        continue;
      }
      const vec3 p = ray.origin + ray.direction * float(exact.t);
      const vec3 position = at3(film, Plane::POSITION, i);
      const float tolerance = exact.sphere ? 5e-3f : 1e-4f;
      CHECK(length(position - p) < tolerance);
      CHECK(length(project(camera, position).raster - raster) < 0.01f);
      CHECK(film.centre(Plane::DISTANCE, i) == Approx(exact.t).margin(tolerance));
      const vec3 p_camera = at3(film, Plane::POSITION_CAMERA, i);
      CHECK(film.centre(Plane::DEPTH, i) == p_camera.z);
      CHECK(p_camera.z ==
            Approx(-transform_point(camera.camera_from_world, p).z).margin(tolerance));
      const vec3 n = exact.sphere ? p - center : vec3(0, 0, 1);
      CHECK(length(at3(film, Plane::NORMAL, i) - n) < (exact.sphere ? 1e-2f : 1e-5f));
      CHECK(length(at3(film, Plane::GEOMETRIC_NORMAL, i) - n) < (exact.sphere ? 4e-2f : 1e-5f));
      CHECK(dot(at3(film, Plane::GEOMETRIC_NORMAL, i), ray.direction) <= 0);
      CHECK(length(at3(film, Plane::NORMAL_CAMERA, i) -
                   cv_from_gl(transform_vector(camera.camera_from_world,
                                               at3(film, Plane::NORMAL, i)))) < 1e-5f);
      const vec3 tangent = exact.sphere ? vec3(-n.y, n.x, 0) / length(vec2(n)) : vec3(1, 0, 0);
      if (std::fabs(n.z) < 0.99f || !exact.sphere) {
        CHECK(length(at3(film, Plane::TANGENT, i) - tangent) < (exact.sphere ? 0.05f : 1e-5f));
      }
      if (exact.sphere) {
        CHECK(length(at3(film, Plane::OBJECT_COORDINATES, i) - (n * 0.5f + 0.5f)) < 3e-3f);
        CHECK(length(at3(film, Plane::NOCS, i) - (vec3(0.5f) + n * 0.5f / std::sqrt(3.0f))) <
              3e-3f);
        continue;
      }
      CHECK(length(at3(film, Plane::OBJECT_COORDINATES, i) -
                   vec3(p.x / 8 + 0.5f, p.y / 8 + 0.5f, 0.5f)) < 1e-4f);
      CHECK(film.centre(Plane::NOCS, 3 * i) ==
            Approx(0.5f + p.x / 8 * std::sqrt(0.5f)).margin(1e-4));
      CHECK(film.centre(Plane::UV, 2 * i) == Approx(p.x / 8 + 0.5f).margin(1e-4));
      CHECK(film.centre(Plane::UV, 2 * i + 1) == Approx(p.y / 8 + 0.5f).margin(1e-4));
      const u32 primitive = film.centre<u32>(Plane::PRIMITIVE, i);
      CHECK(primitive == (p.x > p.y ? 0u : 1u));
      const float u = film.centre(Plane::BARYCENTRIC, 2 * i);
      const float v = film.centre(Plane::BARYCENTRIC, 2 * i + 1);
      const TestMesh mesh = rectangle(4, 4);
      const uvec3 t = mesh.triangles[primitive];
      CHECK(length(mesh.positions[t.x] * (1 - u - v) + mesh.positions[t.y] * u +
                   mesh.positions[t.z] * v - p) < 1e-4f);
      CHECK(at3(film, Plane::BASE_COLOR, i) == vec3(0.2f, 0.4f, 0.6f));
      CHECK(film.centre(Plane::ROUGHNESS, i) == 0.3f);
      CHECK(film.centre(Plane::METALLIC, i) == 0.25f);
      CHECK(film.centre(Plane::TRANSMISSION, i) == 0.125f);
      CHECK((film.centre(Plane::OPACITY, i) == 1 && film.centre(Plane::IOR, i) == 1.5f));
      CHECK(at3(film, Plane::EMISSION, i) == vec3(2, 4, 6));
    }
    CHECK((seen[0] > 50 && seen[1] > 50 && seen[2] > 50));
  }
}

TEST_CASE("probe: mesh parts count on from an instance's part, unless all of it is one") {
  TestScene scene;
  TestMesh mesh = rectangle(1, 1);
  mesh.parts = {0, 1};  // below and above the diagonal x = y
  const u32 paint = scene.add(painted());
  scene.add_instance(scene.add(mesh), {paint, paint}, mat4x3(1));
  scene.instances[0].part = 5;
  const SceneView& view = scene.finish();
  const CameraView camera = look_at({0.5f, -0.5f, 4}, {0.5f, -0.5f, 0}, {1, 1}, 0.01f);
  const CameraView other = look_at({-0.5f, 0.5f, 4}, {-0.5f, 0.5f, 0}, {1, 1}, 0.01f);
  const auto part = [&](const CameraView& from) {
    const TestFilm film({1, 1}, all_centre());
    probe_all({{&view, &from}, {}, {}, nullptr, &kSettings, scene.rest_boxes.data()}, film);
    return film.centre<u32>(Plane::PART, 0);
  };
  CHECK(part(camera) == 5);
  CHECK(part(other) == 6);
  scene.instances[0].flags |= kOnePart;
  CHECK(part(camera) == 5);
  CHECK(part(other) == 5);
  scene.instances[0].label = 0;
  CHECK(part(other) == 0);
}

TEST_CASE("probe: normals face the viewer from behind, and emission does not pass the back") {
  const World world({0, 0, 100});
  const CameraView camera = look_at({1, 0, -5}, {0, 0, 0}, {4, 4}, 0.1f);
  const TestFilm film({4, 4}, all_centre());
  probe_all({{world.view, &camera}, {}, {}, nullptr, &kSettings, world.scene.rest_boxes.data()},
            film);
  CHECK(at3(film, Plane::GEOMETRIC_NORMAL, 5).z == -1);
  CHECK(at3(film, Plane::NORMAL, 5).z == -1);
  CHECK(is_black(at3(film, Plane::EMISSION, 5)));
}

TEST_CASE("probe: flow is the reprojection of a moving sphere and a moving camera") {
  const vec3 before(0.5f, -0.3f, 1.2f), after(0.8f, 0.1f, 1.4f);
  const mat3 turn = rotation({0, 1, 1}, 0.2f);
  const World now(before);
  World later(after, turn);
  const CameraView camera = look_at({5, -4, 3.5f}, {0.2f, 0, 0.5f}, kSize, 1.1f);
  const CameraView moved = look_at({4.8f, -4.2f, 3.6f}, {0.25f, 0, 0.5f}, kSize, 1.1f);
  const TestFilm film(kSize, all_centre());
  probe_all({{now.view, &camera},
             {later.view, &moved},
             {now.view, &camera},
             nullptr,
             &kSettings,
             now.scene.rest_boxes.data()},
            film);
  int seen[3] = {}, hidden = 0;
  for (u64 i = 0; i < u64(kSize.x) * kSize.y; ++i) {
    const u32 column = i % kSize.x, row = i / kSize.x;
    const vec2 raster(float(column) + 0.5f, float(row) + 0.5f);
    const u32 label = film.centre<u32>(Plane::INSTANCE, i);
    const vec2 flow(film.centre(Plane::FLOW_FORWARD, 2 * i),
                    film.centre(Plane::FLOW_FORWARD, 2 * i + 1));
    CHECK(film.centre<u8>(Plane::FLOW_FORWARD_VALID, i) == 1);
    // Nothing moves backwards here.
    CHECK(film.centre(Plane::FLOW_BACKWARD, 2 * i) == Approx(0).margin(1e-4));
    CHECK(film.centre<u8>(Plane::FLOW_BACKWARD_VALID, i) == 1);
    CHECK(film.centre<u8>(Plane::FLOW_BACKWARD_VISIBLE, i) == (label != 0));
    if (label == 0) {
      const vec3 d = camera_ray(camera, raster, {0, true}).direction;
      CHECK(length(flow - (project(moved, moved.world_from_camera[3] + d).raster - raster)) <
            0.01f);
      CHECK(film.centre<u8>(Plane::FLOW_FORWARD_VISIBLE, i) == 0);
      CHECK(is_black(at3(film, Plane::SCENE_FLOW, i)));
      ++seen[0];
      continue;
    }
    const vec3 p = at3(film, Plane::POSITION, i);
    const vec3 there = label == 9 ? turn * (p - before) + after : p;
    CHECK(length(flow - (project(moved, there).raster - raster)) < 0.02f);
    CHECK(length(at3(film, Plane::SCENE_FLOW, i) - (there - p)) < 1e-5f);
    const Ray ray = camera_ray_to(moved, there, {0, true});
    const Exact exact = exact_hit(ray, after);
    const float rim = length(cross(after - ray.origin, ray.direction));
    const bool inside = inside_image(moved, project(moved, there).raster);
    if (std::fabs(rim - 1) > 0.03f) {
      const bool visible = inside && exact.t > double(ray.t_max) - 0.01;
      CHECK(bool(film.centre<u8>(Plane::FLOW_FORWARD_VISIBLE, i)) == visible);
      hidden += !visible;
    }
    ++seen[label == 9 ? 1 : 2];
  }
  CHECK((seen[0] > 50 && seen[1] > 50 && seen[2] > 50 && hidden > 5));

  later.scene.instances[1].flags |= kFlowInvalid;
  probe_all({{now.view, &camera},
             {later.view, &moved},
             {},
             nullptr,
             &kSettings,
             now.scene.rest_boxes.data()},
            film);
  for (u64 i = 0; i < u64(kSize.x) * kSize.y; ++i) {
    const bool sphere = film.centre<u32>(Plane::INSTANCE, i) == 9;
    CHECK(film.centre<u8>(Plane::FLOW_FORWARD_VALID, i) == !sphere);
    if (sphere) CHECK(film.centre(Plane::FLOW_FORWARD, 2 * i) == 0);
  }
}

TEST_CASE("probe: disparity of a rectified rig is focal length times baseline over depth") {
  const World world({0.5f, -0.3f, 1.2f});
  const CameraView left = look_at({5, -4, 3.5f}, {0.2f, 0, 0.5f}, kSize, 1.1f);
  CameraView right = left;
  right.world_from_camera[3] += left.world_from_camera[0] * 0.3f;
  right.camera_from_world = heliograph::test::inverse(right.world_from_camera);
  const TestFilm film(kSize, all_centre());
  probe_all({{world.view, &left}, {}, {}, &right, &kSettings, world.scene.rest_boxes.data()}, film);
  int hidden = 0, visible = 0;
  for (u64 i = 0; i < u64(kSize.x) * kSize.y; ++i) {
    const float depth = film.centre(Plane::DEPTH, i);
    const float expected = std::isfinite(depth) ? left.fx * 0.3f / depth : 0;
    CHECK(film.centre(Plane::DISPARITY, i) == Approx(expected).margin(1e-3));
    const bool sees = film.centre<u8>(Plane::DISPARITY_VISIBLE, i);
    if (!std::isfinite(depth)) CHECK(!sees);
    (sees ? visible : hidden) += std::isfinite(depth);
    const float x = float(i % kSize.x) + 0.5f - expected;
    if (x < 0) CHECK(!sees);
  }
  CHECK((hidden > 5 && visible > 200));
}

TEST_CASE(
    "probe: takes the first surface that is at least half opaque; looks through glass if told") {
  TestScene scene;
  scene.add_instance(scene.add(rectangle(4, 4)), scene.add(painted()));
  const u32 mesh = scene.add(rectangle(4, 4));
  MaterialView veil = lambert(vec3(1));
  veil.alpha_mode = AlphaMode::kBlend;
  veil.constant.alpha = 0.49f;
  scene.add_instance(mesh, scene.add(veil), pose(mat3(1), {0, 0, 1}));
  veil.constant.alpha = 0.75f;
  scene.add_instance(mesh, scene.add(veil), pose(mat3(1), {0, 0, -3}));
  MaterialView glass = standard_material();
  glass.constant.transmission = 1;
  glass.constant.roughness = 0;
  scene.add_instance(mesh, scene.add(glass), pose(mat3(1), {0, 0, 2}));
  const SceneView& view = scene.finish();
  Settings settings = kSettings;
  const auto label = [&](float z, bool through) {
    settings.through_transmission = through;
    const CameraView camera = look_at({0.3f, 0.1f, z}, {0.3f, 0.2f, 0}, {1, 1}, 0.1f);
    const TestFilm film({1, 1}, all_centre());
    probe_all({{&view, &camera}, {}, {}, nullptr, &settings, scene.rest_boxes.data()}, film);
    const vec3 p = at3(film, Plane::POSITION, 0);
    CHECK(length(p - camera.world_from_camera[3]) ==
          Approx(film.centre(Plane::DISTANCE, 0)).epsilon(1e-5));
    const u32 found = film.centre<u32>(Plane::INSTANCE, 0);
    CHECK(film.centre(Plane::OPACITY, 0) == (found == 3 ? 0.75f : 1));
    return found;
  };
  CHECK(label(5, false) == 4);
  CHECK(label(5, true) == 1);
  CHECK(label(1.5f, false) == 1);
  CHECK(label(-5, false) == 3);
}

TEST_CASE("probe: what a body of higher priority displaces is not there") {
  const auto seen = [](i32 priority_of_glass, float eye, bool through) {
    TestScene scene;
    scene.add_instance(scene.add(rectangle(4, 4)), scene.add(painted()));
    MaterialView glass = standard_material();
    glass.constant.transmission = 1;
    glass.constant.roughness = 0;
    glass.priority = priority_of_glass;
    scene.add_instance(scene.add(block({-4, -4, 1}, {4, 4, 2})), scene.add(glass));
    MaterialView frosted = glass;
    frosted.constant.roughness = 0.6f;
    frosted.priority = 1;
    scene.add_instance(scene.add(block({-3, -3, 1.2f}, {3, 3, 1.8f})), scene.add(frosted));
    const SceneView& view = scene.finish();
    Settings settings = kSettings;
    settings.through_transmission = through;
    const CameraView camera = look_at({0.3f, 0.1f, eye}, {0.3f, 0.2f, 0}, {1, 1}, 0.1f);
    const TestFilm film({1, 1}, all_centre());
    probe_all({{&view, &camera}, {}, {}, nullptr, &settings, scene.rest_boxes.data()}, film);
    return std::pair(film.centre<u32>(Plane::INSTANCE, 0), film.centre(Plane::POSITION, 2));
  };
  const auto is = [](u32 label, float z) {
    return [=](const std::pair<u32, float>& at) {
      return at.first == label && std::fabs(at.second - z) < 1e-5f;
    };
  };
  CHECK(is(1, 0)(seen(2, 5, true)));
  CHECK(is(3, 1.8f)(seen(0, 5, true)));
  CHECK(is(2, 2)(seen(2, 5, false)));
  CHECK(is(2, 2)(seen(0, 5, false)));
  // From within.
  CHECK(is(2, 1)(seen(2, 1.9f, false)));
  CHECK(is(3, 1.8f)(seen(0, 1.9f, false)));
  CHECK(is(2, 1)(seen(2, 1.5f, false)));
  CHECK(is(1, 0)(seen(2, 1.5f, true)));
}

TEST_CASE("probe: glass before a point hides it from the other camera unless looked through") {
  TestScene scene;
  scene.add_instance(scene.add(rectangle(4, 4)), scene.add(painted()));
  MaterialView glass = standard_material();
  glass.constant.transmission = 1;
  glass.constant.roughness = 0;
  scene.add_instance(scene.add(rectangle(4, 4)), scene.add(glass), pose(mat3(1), {0, 0, 2}));
  const SceneView& view = scene.finish();
  const CameraView camera = look_at({0, 0.1f, 1}, {0.3f, 0.1f, 0}, {1, 1}, 0.1f);
  const CameraView above = look_at({0, 0.1f, 5}, {0.3f, 0.1f, 0}, {1, 1}, 0.1f);
  for (const bool through : {false, true}) {
    Settings settings = kSettings;
    settings.through_transmission = through;
    const TestFilm film({1, 1}, all_centre());
    probe_all({{&view, &camera}, {&view, &above}, {}, nullptr, &settings, scene.rest_boxes.data()},
              film);
    CHECK(film.centre<u8>(Plane::FLOW_FORWARD_VISIBLE, 0) == through);
  }
}

TEST_CASE("probe: only wanted planes are written, and no ray is wasted on others") {
  const World world({0.5f, -0.3f, 1.2f});
  const CameraView camera = look_at({5, -4, 3.5f}, {0.2f, 0, 0.5f}, kSize, 1.1f);
  const ProbeContext context{
      {world.view, &camera},        {world.view, &camera}, {}, &camera, &kSettings,
      world.scene.rest_boxes.data()};
  const TestTracer tracer(*world.view);
  const TestFilm film(kSize, plane_bit(Plane::DEPTH));
  CHECK(probe_pixel(context, tracer, &tracer, (const TestTracer*)nullptr, film.view, 24, 16) == 1);
}
