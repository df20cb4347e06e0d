// See describe_scene.h.
#include "server/scene/describe_scene.h"

#include <fnmatch.h>

namespace heliograph::server {
namespace {

class Lister {
 public:
  Lister(const std::string& pattern, v1::DescribeSceneReply& reply)
      : pattern_(pattern), reply_(reply) {}

  void entity(const Snapshot& snapshot, u32 index, const Entity& row) {
    v1::ObjectInfo* object = add(snapshot.entity_id(index), row.name);
    if (object == nullptr) return;
    object->set_parent(row.parent.value);
    object->set_uses(row.children);
  }
  template <Kind K, class T>
  void shared(const Table<Shared<T>>& table) {
    table.for_each([&](u32 index, const Shared<T>& row) {
      v1::ObjectInfo* object = add(Id::make(K, table.version(index), index), row.name);
      if (object != nullptr) object->set_uses(row.uses);
    });
  }

 private:
  v1::ObjectInfo* add(Id id, const std::shared_ptr<const std::string>& name) {
    const char* text = name ? name->c_str() : "";
    if (!pattern_.empty() && ::fnmatch(pattern_.c_str(), text, 0) != 0) return nullptr;
    v1::ObjectInfo* object = reply_.add_objects();
    object->set_id(id.value);
    object->set_name(text);
    return object;
  }
  const std::string& pattern_;
  v1::DescribeSceneReply& reply_;
};

}  // namespace

void describe_counts(const Snapshot& snapshot, v1::DescribeSceneReply& reply) {
  auto& counts = *reply.mutable_counts();
  counts["entities"] = snapshot.entities.count();
  counts["meshes"] = snapshot.meshes.count();
  counts["materials"] = snapshot.materials.count();
  counts["textures"] = snapshot.textures.count();
  counts["volumes"] = snapshot.volumes.count();
  if (!snapshot.categories) return;
  u32 id = 0;
  for (const std::string& name : *snapshot.categories) {
    v1::Category* category = reply.add_categories();
    category->set_id(++id);
    category->set_name(name);
  }
}

void describe_objects(const Snapshot& snapshot, const std::string& pattern,
                      v1::DescribeSceneReply& reply) {
  Lister lister(pattern, reply);
  snapshot.entities.for_each(
      [&](u32 index, const Entity& row) { lister.entity(snapshot, index, row); });
  lister.shared<Kind::kMesh>(snapshot.meshes);
  lister.shared<Kind::kMaterial>(snapshot.materials);
  lister.shared<Kind::kTexture>(snapshot.textures);
  lister.shared<Kind::kVolume>(snapshot.volumes);
}

u64 row_bytes(const Snapshot& snapshot) {
  return u64(snapshot.entities.capacity()) * (sizeof(Entity) + sizeof(mat4x3)) +
         u64(snapshot.meshes.capacity()) * sizeof(Shared<Mesh>) +
         u64(snapshot.materials.capacity()) * (sizeof(Shared<Material>) + sizeof(Material)) +
         u64(snapshot.textures.capacity()) * (sizeof(Shared<Texture>) + sizeof(Texture)) +
         u64(snapshot.volumes.capacity()) * (sizeof(Shared<Volume>) + sizeof(Volume));
}

}  // namespace heliograph::server
