// Seeded mutants of small files: each loads or is refused, and none crashes or takes long. Run in
// this process, so that a sanitizer sees everything.
#include <chrono>
#include <random>

#include "renderer/assets/load.h"
#include "tests/unit/asset_fixture.h"
#include "tests/unit/catch.h"

using namespace heliograph;

namespace {

/// One to eight edits: a byte changed, a number made extreme, a stretch removed or repeated.
std::vector<std::byte> mutate(std::vector<std::byte> bytes, std::mt19937& random) {
  const auto below = [&](std::size_t end) {
    return std::uniform_int_distribution<std::size_t>(0, end - 1)(random);
  };
  const std::size_t edits = 1 + below(8);
  for (std::size_t i = 0; i < edits && bytes.size() > 8; ++i) {
    const std::size_t at = below(bytes.size() - 4);
    switch (below(6)) {
      case 0:
        bytes[at] = std::byte(below(256));
        break;
      case 1:
        bytes[at] ^= std::byte(1u << below(8));
        break;
      case 2:
        std::memset(&bytes[at], below(2) ? 0xff : 0, 4);
        break;
      case 3:
        bytes[at] = std::byte("0123456789-eE.,[]{}\""[below(20)]);
        break;
      case 4:
        bytes.resize(at + 4);
        break;
      default: {
        const std::size_t length = 1 + below(std::min<std::size_t>(16, bytes.size() - at));
        const std::vector<std::byte> part(bytes.begin() + std::ptrdiff_t(at),
                                          bytes.begin() + std::ptrdiff_t(at + length));
        bytes.insert(bytes.begin() + std::ptrdiff_t(at), part.begin(), part.end());
      }
    }
  }
  return bytes;
}

/// Mutates the model, or sometimes a companion. Returns how many still loaded.
u32 fuzz(const std::filesystem::path& model, u32 mutants) {
  const TestBundle original = bundle_of(model);
  LoadOptions options;
  options.limits.bytes = 16 << 20;
  options.limits.texels = 1 << 20;
  u32 loaded = 0;
  for (u32 seed = 0; seed < mutants; ++seed) {
    std::mt19937 random(seed);
    TestBundle mutant = original;
    const std::size_t which = seed % 4 == 3 ? random() % mutant.contents.size() : 0;
    mutant.contents[which] = mutate(mutant.contents[which], random);
    const auto start = std::chrono::steady_clock::now();
    const auto result = mutant.load(options);
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
    INFO(model << " seed " << seed);
    CHECK(took.count() < 5);
    if (result) {
      ++loaded;
    } else {
      CHECK_FALSE(result.error().message.empty());
      CHECK_FALSE(result.error().where.empty());
    }
  }
  return loaded;
}

}  // namespace

TEST_CASE("fuzz: models") {
  u32 loaded = 0;
  const std::filesystem::path folder = test_assets();
  for (const char* name :
       {"gltf/01_morphed_cube/01_morphed_cube.gltf",
        "gltf/03_skinned_cylinder/03_skinned_cylinder.gltf",
        "gltf/09_texture_transform/09_texture_transform.gltf", "gltf/simple-instancing.glb",
        "gltf/Lights.glb", "gltf/heart_draco.glb", "mesh/cube_blender_uv.ply",
        "mesh/spot_control_mesh.obj", "mesh/link_6.stl", "dae/bracket.dae", "dae/banner.dae",
        "dae/bones.dae", "volume/torus.nvdb", "volume/smoke.vdb"}) {
    loaded += fuzz(folder / name, 1500);
  }
  CHECK(loaded > 100);  // the mutants are not all nonsense
}

TEST_CASE("fuzz: profiles of luminaires") {
  CHECK(fuzz(test_assets() / "profile/batwing.ies", 4000) > 100);
}

TEST_CASE("fuzz: pictures") {
  const std::filesystem::path folder = test_assets() / "picture";
  for (const auto& file : std::filesystem::directory_iterator(folder)) {
    if (std::filesystem::file_size(file) > 10'000) continue;
    (void)fuzz(file.path(), 500);
  }
}
