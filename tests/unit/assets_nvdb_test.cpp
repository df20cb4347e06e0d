// .nvdb: what NanoVDB wrote of OpenVDB's grids is read as the numbers that went in.
#include <nanovdb/util/GridBuilder.h>
#include <nanovdb/util/IO.h>

#include <sstream>

#include "tests/unit/asset_fixture.h"
#include "tests/unit/catch.h"
#include "tests/unit/voxels.h"

using namespace heliograph;
using namespace heliograph::test;
using Catch::Matchers::Contains;

namespace {

/// Counts times `scale`, as NanoVDB's type Build.
template <class Build, class Source = Build>
std::string written(double scale, nanovdb::io::Codec codec) {
  nanovdb::GridBuilder<Source, Build> builder(Source(0));
  auto accessor = builder.getAccessor();
  each_voxel([&](ivec3 at) {
    if (count_at(at) != 0)
      accessor.setValue(nanovdb::Coord(at.x, at.y, at.z), Source(count_at(at) * scale));
  });
  const auto handle = builder.getHandle(0.5, nanovdb::Vec3d(1, 2, 3), "density");
  nanovdb::io::Segment segment(codec);
  segment.add(handle);
  std::ostringstream header, nodes;
  segment.meta[0].fileSize = nanovdb::io::Internal::write(nodes, handle, codec);
  segment.write(header);
  return header.str() + nodes.str();
}

template <class Build, class Source = Build>
void check(double scale, float tolerance = 0) {
  for (const auto codec :
       {nanovdb::io::Codec::NONE, nanovdb::io::Codec::ZIP, nanovdb::io::Codec::BLOSC}) {
    const auto loaded = TestBundle().add("a.nvdb", written<Build, Source>(scale, codec)).load();
    INFO(refusal(loaded));
    REQUIRE(loaded);
    const auto density = library_item<PutVolume>(*loaded).density;
    int wrong = 0;
    each_voxel([&](ivec3 at) {
      wrong += std::abs(voxel(*density, at) - float(count_at(at) * scale)) > tolerance;
    });
    CHECK(wrong == 0);
    CHECK(density->lower == ivec3(-10, -4, 4));
    const vec3 sample = density->object_from_voxel * vec4(0.5f, 0.5f, 0.5f, 1);
    CHECK(sample == vec3(1, 2, 3));
  }
}

}  // namespace

TEST_CASE("nvdb: numbers of every type, plain and packed") {
  check<float>(0.125);
  check<double>(0.125);
  check<std::int16_t>(3);
  check<i32>(3);
  check<i64>(3);
  check<u32>(3);
}

TEST_CASE("nvdb: quantised numbers are within half a step") {
  constexpr float kRange = 15 * 0.125f;
  check<nanovdb::Fp4, float>(0.125, kRange / 15 / 2 + 1e-6f);
  check<nanovdb::Fp8, float>(0.125, kRange / 255 / 2 + 1e-6f);
  check<nanovdb::Fp16, float>(0.125, kRange / 65535 / 2 + 1e-6f);
  check<nanovdb::FpN, float>(0.125, 0.01f);
}

TEST_CASE("nvdb: files of newer minor versions say so in their magic") {
  std::string file = written<float>(0.125, nanovdb::io::Codec::NONE);
  const std::size_t grid = file.find("NanoVDB0", 8);
  file[7] = '2';         // a file
  file[grid + 7] = '1';  // a grid
  CHECK(TestBundle().add("a.nvdb", file).load());
  file[grid] = 'X';
  CHECK_THAT(refusal(TestBundle().add("a.nvdb", file).load()),
             Contains("density: is not a NanoVDB grid"));
}

TEST_CASE("nvdb: nodes outside of their grid are refused") {
  const std::string file = written<float>(0.125, nanovdb::io::Codec::NONE);
  const std::size_t grid = file.find("NanoVDB0", 8);
  const auto with = [&](std::size_t at, u64 value) {
    std::string bad = file;
    std::memcpy(bad.data() + grid + at, &value, sizeof value);
    return refusal(TestBundle().add("a.nvdb", bad).load());
  };
  constexpr std::size_t kRootOffset = sizeof(nanovdb::GridData) + 24;
  for (const u64 offset : {u64(1) << 40, ~u64(0) - 4095, u64(33)})
    CHECK_THAT(with(kRootOffset, offset), Contains("density: a node leaves its grid"));
}
