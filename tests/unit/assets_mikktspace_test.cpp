// Tangents of meshes against closed forms, and against themselves in another order.
#include "renderer/assets/mikktspace.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "renderer/assets/load.h"
#include "tests/unit/catch.h"

using namespace heliograph;
using namespace heliograph::assets;

namespace {

constexpr double kPi = std::numbers::pi;

MeshData with_tangents(MeshData mesh) {
  const LoadLimits limits;
  Budget budget(limits);
  add_tangents(mesh, budget);
  return mesh;
}

vec4 tangent(const MeshData& mesh, std::size_t triangle, int corner) {
  return mesh.tangents[mesh.triangles[triangle][corner]];
}

/// Two triangles, [0, 1]^2, that face +z.
MeshData quad(const std::vector<vec2>& uvs) {
  return {.positions = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}},
          .normals = std::vector<vec3>(4, vec3(0, 0, 1)),
          .uvs = uvs,
          .triangles = {{0, 1, 2}, {0, 2, 3}}};
}

/// Triangles about the origin, which is vertex 0; the last does not meet the first.
MeshData fan(const std::vector<vec3>& rim, const std::vector<vec2>& uvs) {
  MeshData mesh{.positions = {vec3(0)}, .uvs = uvs};
  mesh.positions.insert(mesh.positions.end(), rim.begin(), rim.end());
  mesh.normals.assign(mesh.positions.size(), vec3(0, 0, 1));
  for (u32 i = 1; i < rim.size(); ++i) mesh.triangles.emplace_back(0, i, i + 1);
  return mesh;
}

/// A bumpy square of size^2 cells; its texture is mirrored at the middle, with a flat spot.
MeshData bumpy(u32 size) {
  std::mt19937 random(7);
  std::uniform_real_distribution<float> any(-0.3f, 0.3f);
  const u32 middle = size / 2;
  MeshData mesh;
  for (u32 y = 0; y <= size; ++y) {
    for (u32 x = 0; x <= size; ++x) {
      mesh.positions.emplace_back(float(x) + any(random), float(y) + any(random), any(random));
      mesh.normals.push_back(glm::normalize(vec3(any(random), any(random), 1)));
      const float u = std::abs(float(x) - float(middle));
      mesh.uvs.push_back(x < 3 && y < 3 ? vec2(0) : vec2(u, float(y) + any(random)));
    }
  }
  for (u32 y = 0; y < size; ++y) {
    for (u32 x = 0; x < size; ++x) {
      const u32 a = y * (size + 1) + x, b = a + size + 1;
      mesh.triangles.emplace_back(a, a + 1, b + 1);
      mesh.triangles.emplace_back(a, b + 1, b);
    }
  }
  return mesh;
}

}  // namespace

TEST_CASE("tangents: on a plane along u, however the texture is turned") {
  for (const double turn : {0.0, 0.7, 2.0, 4.0}) {
    for (const float side : {1.0f, -1.0f}) {
      CAPTURE(turn, side);
      const vec2 u(float(std::cos(turn)), float(std::sin(turn)));
      std::vector<vec2> uvs;
      for (const vec3& p : quad({}).positions) {
        const vec2 at(p);
        uvs.emplace_back(3 * glm::dot(u, at), side * glm::dot(vec2(-u.y, u.x), at));
      }
      const MeshData mesh = with_tangents(quad(uvs));
      CHECK(mesh.positions.size() == 4);
      for (const vec4& t : mesh.tangents) CHECK(glm::length(t - vec4(u, 0, side)) < 1e-6f);
    }
  }
}

TEST_CASE("tangents: around a cylinder, whose vertices at the seam are there twice") {
  constexpr u32 kAround = 24;
  MeshData mesh;
  for (u32 i = 0; i <= kAround; ++i) {
    const double angle = 2 * kPi * i / kAround;
    for (int z = 0; z < 2; ++z) {
      const vec3 out(float(std::cos(angle)), float(std::sin(angle)), 0);
      mesh.positions.push_back(out + vec3(0, 0, z));
      mesh.normals.push_back(out);
      mesh.uvs.emplace_back(float(i) / kAround, z);
    }
    if (i == kAround) break;
    mesh.triangles.emplace_back(2 * i, 2 * i + 2, 2 * i + 3);
    mesh.triangles.emplace_back(2 * i, 2 * i + 3, 2 * i + 1);
  }
  const MeshData made = with_tangents(mesh);
  REQUIRE(made.tangents.size() == mesh.positions.size());
  for (std::size_t v = 0; v < made.tangents.size(); ++v) {
    const vec3 n = mesh.normals[v];
    CHECK(glm::length(made.tangents[v] - vec4(-n.y, n.x, 0, 1)) < 2e-6f);
  }
}

TEST_CASE("tangents: around a ball, closer the finer it is") {
  const auto worst = [](u32 rings) {
    MeshData mesh;
    const u32 row = 2 * rings + 1;
    for (u32 y = 0; y <= rings; ++y) {
      for (u32 x = 0; x < row; ++x) {
        const double u = double(x) / (row - 1), v = double(y) / rings;
        const double s = std::sin(kPi * v);
        mesh.positions.emplace_back(s * std::cos(2 * kPi * u), s * std::sin(2 * kPi * u),
                                    -std::cos(kPi * v));
        mesh.uvs.emplace_back(u, v);
        if (x + 1 == row || y == rings) continue;
        const u32 a = y * row + x;
        mesh.triangles.emplace_back(a, a + 1, a + row + 1);
        mesh.triangles.emplace_back(a, a + row + 1, a + row);
      }
    }
    mesh.normals = mesh.positions;
    const MeshData made = with_tangents(mesh);
    float largest = 0;
    for (std::size_t v = 0; v < mesh.positions.size(); ++v) {
      const vec3 n = mesh.normals[v];
      if (std::abs(n.z) > 0.9f) continue;
      const vec3 exact = glm::normalize(vec3(-n.y, n.x, 0));
      largest = std::max(largest, glm::length(made.tangents[v] - vec4(exact, 1)));
    }
    return largest;
  };
  CHECK(worst(32) < 0.05f);
  CHECK(worst(128) < 0.0125f);
}

TEST_CASE("tangents: vertices where the texture is mirrored are split, with all they have") {
  MeshData mesh;
  for (int x = -1; x <= 1; ++x) {
    for (int y = 0; y < 2; ++y) {
      mesh.positions.emplace_back(x, y, 0);
      mesh.uvs.emplace_back(std::abs(x), y);
    }
  }
  mesh.normals.assign(6, vec3(0, 0, 1));
  mesh.triangles = {{0, 2, 3}, {0, 3, 1}, {2, 4, 5}, {2, 5, 3}};
  for (u32 v = 0; v < 6; ++v) {
    mesh.uvs1.emplace_back(v, 1);
    mesh.colors.emplace_back(v, 2, 2, 2);
    mesh.joints.emplace_back(v, 3, 3, 3);
    mesh.weights.emplace_back(v, 4, 4, 4);
  }
  mesh.morph_positions = {{6, vec3(5)}, {6, vec3(6)}};
  mesh.morph_normals = {{6, vec3(7)}, {6, vec3(8)}};
  mesh.morph_normals[1][3] = vec3(9);
  const MeshData made = with_tangents(mesh);

  for (std::size_t t = 0; t < 4; ++t) {
    for (int i = 0; i < 3; ++i) {
      CAPTURE(t, i);
      CHECK(tangent(made, t, i) == (t < 2 ? vec4(-1, 0, 0, -1) : vec4(1, 0, 0, 1)));
      const u32 v = made.triangles[t][i], from = mesh.triangles[t][i];
      CHECK((v == from || (t < 2 && v >= 6)));
      CHECK(made.positions[v] == mesh.positions[from]);
      CHECK(made.normals[v] == mesh.normals[from]);
      CHECK(made.uvs[v] == mesh.uvs[from]);
      CHECK(made.uvs1[v] == mesh.uvs1[from]);
      CHECK(made.colors[v] == mesh.colors[from]);
      CHECK(made.joints[v] == mesh.joints[from]);
      CHECK(made.weights[v] == mesh.weights[from]);
      for (std::size_t m = 0; m < 2; ++m) {
        CHECK(made.morph_positions[m][v] == mesh.morph_positions[m][from]);
        CHECK(made.morph_normals[m][v] == mesh.morph_normals[m][from]);
      }
    }
  }
  CHECK(made.positions.size() == 8);
  CHECK(made.morph_normals[1].size() == 8);
}

TEST_CASE("tangents: triangles add their directions by their angles, in the plane of the normal") {
  const std::vector<vec3> rim = {{2, 0, 0.5f}, {1, 0.4f, -0.2f}, {0, 1, 0.3f}, {-3, 1, 0}};
  const std::vector<vec2> uvs = {{0, 0}, {1, 0}, {1, 1}, {-0.2f, 1}, {-1, 0.5f}};
  MeshData mesh = fan(rim, uvs);
  const vec3 n = glm::normalize(vec3(0.2f, -0.1f, 1));
  mesh.normals[0] = 5.0f * n;
  const glm::dvec3 normal(n);
  const auto flat = [&](const glm::dvec3& v) {
    return glm::normalize(v - normal * glm::dot(normal, v));
  };
  glm::dvec3 sum(0);
  for (std::size_t i = 0; i + 1 < rim.size(); ++i) {
    const glm::dvec3 b(rim[i]), c(rim[i + 1]);
    const glm::dvec2 ub(uvs[i + 1]), uc(uvs[i + 2]);
    const double area = ub.x * uc.y - ub.y * uc.x;
    REQUIRE(area > 0);
    sum += std::acos(glm::dot(flat(b), flat(c))) * flat((b * uc.y - c * ub.y) / area);
  }
  const MeshData made = with_tangents(mesh);
  CHECK(glm::length(glm::dvec3(made.tangents[0]) - glm::normalize(sum)) < 1e-6);
  CHECK(made.tangents[0].w == 1);
  CHECK(made.positions.size() == 5);
}

TEST_CASE("tangents: a right angle counts where an edge stands on the surface") {
  // A wall that faces -y and has the normals of the ground; its lower corners see one edge upright.
  const MeshData made =
      with_tangents(fan({{1, 0, 0}, {1, 0, 1}, {0, 0, 1}}, {{0, 0}, {1, 0}, {1, 1}, {0, 1}}));
  for (const vec4& t : made.tangents) CHECK(glm::length(t - vec4(1, 0, 0, 1)) < 1e-6f);
}

TEST_CASE("tangents: triangles that meet at a vertex alone are two groups") {
  MeshData mesh =
      fan({{1, 0, 0}, {0, 1, 0}, {-1, 0, 0}, {0, -1, 0}}, {{0, 0}, {1, 0}, {0, 1}, {0, 1}, {1, 0}});
  mesh.triangles = {{0, 1, 2}, {0, 3, 4}};
  const MeshData two = with_tangents(mesh);
  CHECK(two.positions.size() == 6);
  CHECK(tangent(two, 0, 0) == vec4(1, 0, 0, 1));
  CHECK(glm::length(tangent(two, 1, 0) - vec4(0, -1, 0, -1)) < 1e-6f);

  SECTION("whichever way v grows") {
    mesh.uvs[3] = vec2(1, 1);
    mesh.uvs[4] = vec2(-1, 1);
    const MeshData same_side = with_tangents(mesh);
    CHECK(same_side.positions.size() == 6);
    CHECK(tangent(same_side, 0, 0) == vec4(1, 0, 0, 1));
    CHECK(tangent(same_side, 1, 0).w == 1);
    CHECK(glm::length(vec3(tangent(same_side, 1, 0)) - vec3(-1, 1, 0) / std::sqrt(2.0f)) < 1e-6f);
  }
}

TEST_CASE("tangents: a triangle without an area in the texture joins those beside it") {
  const std::vector<vec3> rim = {{1, 0, 0}, {0, 1, 0}, {-1, 0, 0}, {0, -1, 0}};
  // Along +x, nothing, along -x + y.
  const std::vector<vec2> uvs = {{0, 0}, {1, 0}, {0, 1}, {0, 2}, {-2, 0}};
  const MeshData made = with_tangents(fan(rim, uvs));
  CHECK(made.positions.size() == 5);
  const vec3 last = glm::normalize(vec3(0, 2, 0));  // dP/du of the third: (0, -1) is u = -2
  CHECK(glm::length(vec3(made.tangents[0]) - glm::normalize(vec3(1, 0, 0) + last)) < 1e-6f);
  CHECK(made.tangents[0].w == 1);

  SECTION("without it they are two groups") {
    MeshData apart = fan(rim, uvs);
    apart.triangles.erase(apart.triangles.begin() + 1);
    CHECK(with_tangents(apart).positions.size() == 6);
  }
  SECTION("alone it has none, and no vertex is split for it") {
    MeshData lone = fan(rim, uvs);
    lone.triangles = {{0, 2, 3}};
    const MeshData none = with_tangents(lone);
    CHECK(none.positions.size() == 5);
    CHECK(tangent(none, 0, 0) == vec4(0, 0, 0, 1));
  }
  SECTION("one whose corners coincide takes what is there") {
    MeshData thin = fan(rim, uvs);
    thin.triangles.emplace_back(0, 0, 4);
    thin.triangles.emplace_back(1, 1, 1);
    const MeshData same = with_tangents(thin);
    CHECK(same.positions.size() == 5);
    CHECK(same.tangents == made.tangents);
  }
}

TEST_CASE("tangents: the order of triangles and corners does not matter") {
  const MeshData mesh = bumpy(20);
  const MeshData made = with_tangents(mesh);
  CHECK(made.positions.size() > mesh.positions.size());
  std::mt19937 random(3);
  for (int round = 0; round < 3; ++round) {
    std::vector<std::size_t> order(mesh.triangles.size());
    for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
    std::ranges::shuffle(order, random);
    MeshData other = mesh;
    for (std::size_t i = 0; i < order.size(); ++i) {
      const uvec3 t = mesh.triangles[order[i]];
      other.triangles[i] = uvec3(t.y, t.z, t.x);
    }
    other = with_tangents(other);
    CHECK(other.positions.size() == made.positions.size());
    float largest = 0;
    for (std::size_t i = 0; i < order.size(); ++i) {
      for (int c = 0; c < 3; ++c) {
        const vec4 difference = tangent(other, i, c) - tangent(made, order[i], (c + 1) % 3);
        largest = std::max(largest, glm::length(difference));
      }
    }
    CHECK(largest < 1e-6f);
  }
}

TEST_CASE("tangents: equal vertices are one, zeros of either sign") {
  const MeshData shared = bumpy(8);
  MeshData apart;
  for (const uvec3& t : shared.triangles) {
    const auto first = u32(apart.positions.size());
    for (int i = 0; i < 3; ++i) {
      apart.positions.push_back(shared.positions[t[i]]);
      apart.normals.push_back(shared.normals[t[i]]);
      const bool flip = first % 2 == 1 && shared.uvs[t[i]] == vec2(0);
      apart.uvs.push_back(flip ? vec2(-0.0f) : shared.uvs[t[i]]);
    }
    apart.triangles.emplace_back(first, first + 1, first + 2);
  }
  const MeshData made = with_tangents(shared), other = with_tangents(apart);
  CHECK(other.positions.size() == apart.positions.size());
  for (std::size_t t = 0; t < made.triangles.size(); ++t)
    for (int i = 0; i < 3; ++i) CHECK(tangent(made, t, i) == tangent(other, t, i));
}

TEST_CASE("tangents: many triangles at one edge or vertex take no time of their square") {
  constexpr u32 kMany = 200'000;
  MeshData mesh{.positions = {{0, 0, 0}, {0, 0, 1}}};
  for (u32 i = 0; i < kMany; ++i) mesh.positions.emplace_back(i + 1, i % 7, 0);
  mesh.normals.assign(mesh.positions.size(), vec3(0, 0, 1));
  for (const vec3& p : mesh.positions) mesh.uvs.emplace_back(p.x, p.y + p.z);
  for (u32 i = 2; i < kMany; ++i) mesh.triangles.emplace_back(i % 2, 1 - i % 2, i);
  CHECK(with_tangents(mesh).positions.size() >= mesh.positions.size());
  mesh.triangles.clear();
  for (u32 i = 2; i + 1 < kMany; i += 2) mesh.triangles.emplace_back(0, i, i + 1);
  CHECK(with_tangents(mesh).positions.size() >= mesh.positions.size() + kMany / 2 - 2);
}

TEST_CASE("tangents: memory is asked for") {
  const LoadLimits small{.bytes = 200};
  Budget budget(small);
  MeshData mesh = quad({{0, 0}, {1, 0}, {1, 1}, {0, 1}});
  CHECK_THROWS_AS(add_tangents(mesh, budget), Refused);
}
