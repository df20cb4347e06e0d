// Small scenes made through apply(), and renders that wait. Shared by the tests of the engine.
#pragma once

#include <fmt/format.h>

#include <future>

#include "renderer/scene/scene.h"
#include "renderer/schedule/engine.h"
#include "tests/unit/catch.h"

namespace heliograph::test {

inline mat4x3 translation(vec3 t) {
  mat4x3 m(1);
  m[3] = t;
  return m;
}
inline mat4x3 scaled(vec3 s, vec3 t) {
  mat4x3 m(1);
  for (int i = 0; i < 3; ++i) m[i][i] = s[i];
  m[3] = t;
  return m;
}
/// Camera pose (looks down -Z) at `eye`, facing `target`, +Z up.
inline mat4x3 look_at(vec3 eye, vec3 target) {
  const vec3 z = glm::normalize(eye - target);
  const vec3 up = std::abs(z.z) > 0.999f ? vec3(0, 1, 0) : vec3(0, 0, 1);
  const vec3 x = glm::normalize(glm::cross(up, z));
  return {x, glm::cross(z, x), z, eye};
}

struct Shape {
  std::vector<vec3> positions;
  std::vector<uvec3> triangles;
  std::vector<vec2> uvs;
};
/// Unit square in XY about the origin, facing +Z.
inline Shape quad() {
  return {{{-.5f, -.5f, 0}, {.5f, -.5f, 0}, {.5f, .5f, 0}, {-.5f, .5f, 0}},
          {{0, 1, 2}, {0, 2, 3}},
          {{0, 0}, {1, 0}, {1, 1}, {0, 1}}};
}
/// Cube of side 1 about the origin, outside counter-clockwise.
inline Shape cube() {
  Shape shape;
  for (int axis = 0; axis < 3; ++axis)
    for (const float side : {-1.0f, 1.0f}) {
      vec3 n(0), t(0);
      n[axis] = side;
      t[(axis + 1) % 3] = side;
      const vec3 b = glm::cross(n, t);
      const u32 first = u32(shape.positions.size());
      for (const vec2 c : quad().uvs) {
        shape.positions.push_back(0.5f * n + (c.x - 0.5f) * t + (c.y - 0.5f) * b);
        shape.uvs.push_back(c);
      }
      shape.triangles.push_back({first, first + 1, first + 2});
      shape.triangles.push_back({first, first + 2, first + 3});
    }
  return shape;
}
/// Sphere of radius 1 with 2 * n * n triangles or so.
inline Shape sphere(u32 n) {
  Shape shape;
  for (u32 i = 0; i <= n; ++i)
    for (u32 j = 0; j <= 2 * n; ++j) {
      const float theta = float(M_PI) * float(i) / float(n),
                  phi = float(M_PI) * float(j) / float(n);
      shape.positions.push_back(
          {std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta)});
      shape.uvs.push_back({float(j) / float(2 * n), 1 - float(i) / float(n)});
    }
  const u32 row = 2 * n + 1;
  for (u32 i = 0; i < n; ++i)
    for (u32 j = 0; j < 2 * n; ++j) {
      const u32 a = i * row + j;
      if (i > 0) shape.triangles.push_back({a, a + row, a + 1});
      if (i + 1 < n) shape.triangles.push_back({a + 1, a + row, a + row + 1});
    }
  return shape;
}

/// Writes a transaction by names.
class Edits {
 public:
  Edits& put(const std::string& name, Action action) {
    transaction_.edits.push_back({Mode::kUpsert, name, std::move(action)});
    return *this;
  }
  Edits& mesh(const std::string& name, Shape shape) {
    auto topology = std::make_shared<MeshTopology>();
    topology->vertex_count = u32(shape.positions.size());
    topology->triangles = ArrayOf(std::move(shape.triangles));
    topology->uvs = ArrayOf(std::move(shape.uvs));
    auto vertices = std::make_shared<VertexKeys>();
    vertices->times = {0};
    vertices->positions = ArrayOf(std::move(shape.positions));
    return put(name, PutMesh{topology, vertices});
  }
  Edits& material(const std::string& name, vec3 base_color) {
    PutMaterial material;
    material.parameters[std::size_t(MaterialParameter::base_color)].value = base_color;
    return put(name, material);
  }
  Edits& object(const std::string& name, const std::string& mesh, const mat4x3& pose,
                const std::string& material = "") {
    PutEntity entity;
    entity.mesh = Ref(mesh);
    entity.pose = PosePatch{{}, {pose}};
    if (!material.empty()) entity.materials = std::vector<Ref>{Ref(material)};
    return put(name, entity);
  }
  Edits& pose(const std::string& name, const mat4x3& pose) {
    PutEntity entity;
    entity.pose = PosePatch{{}, {pose}};
    return put(name, entity);
  }
  Edits& light(const std::string& name, Light light) {
    PutEntity entity;
    entity.light = LightPatch{light, {}};
    return put(name, entity);
  }
  Edits& camera(const std::string& name, const mat4x3& pose, u32 width, u32 height, double f) {
    PutEntity entity;
    entity.pose = PosePatch{{}, {pose}};
    entity.camera = Camera{.width = width,
                           .height = height,
                           .fx = f,
                           .fy = f,
                           .cx = width / 2.0 - 0.5,
                           .cy = height / 2.0 - 0.5};
    return put(name, entity);
  }
  Edits& dome(vec3 color) {
    PutSettings settings;
    settings.dome = PutDome{.color = color};
    return put(settings);
  }
  Edits& put(PutSettings settings) {
    transaction_.edits.push_back({Mode::kUpsert, {}, std::move(settings)});
    return *this;
  }
  [[nodiscard]] const Transaction& transaction() const { return transaction_; }
  [[nodiscard]] std::shared_ptr<const Snapshot> apply(const Snapshot& base = {}) const {
    auto prepared = heliograph::apply(base, transaction_, {});
    if (!prepared) FAIL(prepared.error().where << ": " << prepared.error().message);
    return prepared->snapshot;
  }

 private:
  Transaction transaction_;
};

inline EntityId entity(const Snapshot& snapshot, const std::string& name) {
  const auto id = snapshot.find(name);
  REQUIRE(id.has_value());
  return EntityId(*id);
}

/// A plane, a cube and a sphere under a constant sky, with a small area light; camera "camera".
inline Edits still_life() {
  Light light;
  light.intensity = 20;
  return Edits()
      .mesh("quad", quad())
      .mesh("cube", cube())
      .mesh("sphere", sphere(24))
      .material("grey", vec3(0.6f))
      .material("red", vec3(0.8f, 0.1f, 0.1f))
      .object("floor", "quad", scaled(vec3(10), vec3(0)), "grey")
      .object("box", "cube", translation({0.6f, 0.3f, 0.5f}), "red")
      .object("ball", "sphere", scaled(vec3(0.5f), {-0.6f, -0.2f, 0.5f}), "grey")
      .object("lamp", "quad", mat4x3(1, 0, 0, 0, -1, 0, 0, 0, -1, 0, 0, 3), "grey")
      .light("lamp", light)
      .dome(vec3(0.3f, 0.4f, 0.5f))
      .camera("camera", look_at({4, -4, 3}, {0, 0, 0.4f}), 64, 48, 60);
}

inline RenderJob job_of(std::shared_ptr<const Snapshot> snapshot, std::vector<Plane> planes,
                        u32 spp = 0, const std::string& camera = "camera") {
  RenderJob job;
  job.cameras = {entity(*snapshot, camera)};
  job.time = snapshot->time;
  job.snapshot = std::move(snapshot);
  job.planes = std::move(planes);
  job.stop.spp = spp;
  job.settings = {.seed = 7,
                  .max_depth = 6,
                  .roulette_depth = 3,
                  .clamp = INFINITY,
                  .clamp_indirect = INFINITY,
                  .filter = kernels::PixelFilter::kBox};
  return job;
}

/// Keeps what a job sends.
class Collect final : public JobSink {
 public:
  void progress(const Progress& p) override { last_progress = p; }
  void frame(std::shared_ptr<const Frame> frame) override { frames.push_back(std::move(frame)); }
  void done(Status status, const Spent& took) override {
    spent = took;
    status_.set_value(std::move(status));
  }
  Status wait() { return status_.get_future().get(); }

  std::vector<std::shared_ptr<const Frame>> frames;
  Progress last_progress;
  Spent spent;

 private:
  std::promise<Status> status_;
};

inline std::unique_ptr<Engine> make_engine(u32 threads = 0) {
  auto engine = Engine::create({.device = {.threads = threads}});
  REQUIRE(engine.has_value());
  return *std::move(engine);
}

inline std::shared_ptr<const Frame> render(Engine& engine, RenderJob job) {
  auto sink = std::make_shared<Collect>();
  const Status submitted =
      engine.submit(std::make_shared<const RenderJob>(std::move(job)), sink, {});
  if (!submitted) FAIL(submitted.error().where << ": " << submitted.error().message);
  const Status status = sink->wait();
  if (!status) FAIL(status.error().where << ": " << status.error().message);
  REQUIRE(!sink->frames.empty());
  return sink->frames.back();
}

template <class T>
std::span<const T> pixels(const Frame& frame, std::size_t plane = 0) {
  const auto& bytes = frame.planes.at(plane).pixels;
  return {reinterpret_cast<const T*>(bytes.data()), bytes.size() / sizeof(T)};
}
inline bool same_planes(const Frame& a, const Frame& b) {
  for (std::size_t i = 0; i < a.planes.size(); ++i)
    if (a.planes[i].pixels != b.planes.at(i).pixels) return false;
  return a.planes.size() == b.planes.size();
}

}  // namespace heliograph::test
