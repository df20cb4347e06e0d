// Labels of a scene may be made while the next one is being made from it: worlds are rendered so.
#include "renderer/bvh/accelerator.h"
#include "renderer/resident/scene.h"
#include "tests/unit/render_scene.h"

using namespace heliograph;
using namespace heliograph::resident;
using namespace heliograph::test;

namespace {

/// Asks the placement before for its labels in the middle of the next one.
class Asking final : public Accelerator {
 public:
  explicit Asking(DerivedCache& cache) : cache_(cache) {}
  [[nodiscard]] Expected<std::shared_ptr<const MeshAccelerator>> build(
      const DeviceMesh& mesh, const Interrupt& interrupt) const override {
    return inner_.build(mesh, interrupt);
  }
  [[nodiscard]] Expected<std::shared_ptr<const SceneAccelerator>> build(
      const Snapshot& snapshot, const Placement& placement, const Kept& kept,
      const Interrupt& interrupt) const override {
    if (kept.before) CHECK(kept.before->labels(*first, MeshBuilder(inner_, cache_), {}));
    return inner_.build(snapshot, placement, kept, interrupt);
  }
  const Snapshot* first = nullptr;

 private:
  bvh::BvhAccelerator inner_{0};
  DerivedCache& cache_;
};

TEST_CASE("labels that are made late are of their own scene") {
  PutEntity labelled;
  labelled.label = LabelPatch{.kind = LabelPatch::Kind::kValue, .value = 7};
  mat4x3 moved(1);
  moved[3] = vec3(5, 0, 0);
  Edits edits;
  edits.mesh("cube", cube());
  edits.object("box", "cube", mat4x3(1)).put("box", labelled);
  const auto first = edits.apply();
  Edits move;
  move.pose("box", moved);
  const auto second = heliograph::apply(*first, move.transaction(), {})->snapshot;

  DerivedCache cache(1 << 30);
  Asking accelerator(cache);
  accelerator.first = first.get();
  SceneStore store(accelerator, cache, 1u << 30);
  const auto before = store.prepare(first, {0, 0}, Interrupt{});
  const auto after = store.prepare(second, {0, 0}, Interrupt{});
  REQUIRE(before);
  REQUIRE(after);
  const auto labels = (*after)->labels({});
  REQUIRE(labels);
  CHECK((*labels)->frames[0].world_from_object[3].x == 5);
}

}  // namespace
