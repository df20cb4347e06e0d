// See describe_scene.h.
#include "server/scene/describe_scene.h"

#include <fnmatch.h>

#include <algorithm>

namespace heliograph::server {
namespace {

/// Lists kinds one after another; a key is the kind's number in this order, then the index.
class Lister {
 public:
  Lister(const std::string& pattern, Page& page, v1::DescribeSceneReply& reply)
      : pattern_(pattern), page_(page), reply_(reply) {}

  void entities(const Snapshot& snapshot) {
    list(snapshot.entities, [&](u32 index, const Entity& row, v1::ObjectInfo& object) {
      object.set_id(snapshot.entity_id(index).value);
      object.set_parent(row.parent.value);
      object.set_uses(row.children);
    });
  }
  template <Kind K, class T>
  void shared(const Table<Shared<T>>& table) {
    list(table, [&](u32 index, const Shared<T>& row, v1::ObjectInfo& object) {
      object.set_id(Id::make(K, table.version(index), index).value);
      object.set_uses(row.uses);
    });
  }

 private:
  template <class T, class Fill>
  void list(const Table<T>& table, const Fill& fill) {
    const u64 base = kinds_++ << 32;
    const u64 first = std::max(page_.first(), base) - base;
    for (u64 index = first; index < table.capacity() && page_.next().empty(); ++index) {
      if (!table.alive(u32(index))) continue;
      const T& row = table.at(u32(index));
      const char* name = row.name ? row.name->c_str() : "";
      if (!pattern_.empty() && ::fnmatch(pattern_.c_str(), name, 0) != 0) continue;
      v1::ObjectInfo object;
      object.set_name(name);
      fill(u32(index), row, object);
      if (page_.take(base + index, object.ByteSizeLong())) *reply_.add_objects() = object;
    }
  }

  const std::string& pattern_;
  Page& page_;
  v1::DescribeSceneReply& reply_;
  u64 kinds_ = 0;
};

}  // namespace

void describe_counts(const Snapshot& snapshot, v1::ObjectCounts& counts) {
  counts.set_entities(snapshot.entities.count());
  counts.set_meshes(snapshot.meshes.count());
  counts.set_materials(snapshot.materials.count());
  counts.set_textures(snapshot.textures.count());
  counts.set_volumes(snapshot.volumes.count());
}

void describe_categories(const Snapshot& snapshot, v1::DescribeSceneReply& reply) {
  if (!snapshot.categories) return;
  u32 id = 0;
  for (const std::string& name : *snapshot.categories) {
    v1::Category* category = reply.add_categories();
    category->set_id(++id);
    category->set_name(name);
  }
}

void describe_objects(const Snapshot& snapshot, const std::string& pattern, Page& page,
                      v1::DescribeSceneReply& reply) {
  Lister lister(pattern, page, reply);
  lister.entities(snapshot);
  lister.shared<Kind::kMesh>(snapshot.meshes);
  lister.shared<Kind::kMaterial>(snapshot.materials);
  lister.shared<Kind::kTexture>(snapshot.textures);
  lister.shared<Kind::kVolume>(snapshot.volumes);
  reply.set_next_page_token(page.next());
}

u64 row_bytes(const Snapshot& snapshot) {
  return u64(snapshot.entities.capacity()) * (sizeof(Entity) + sizeof(mat4x3)) +
         u64(snapshot.meshes.capacity()) * sizeof(Shared<Mesh>) +
         u64(snapshot.materials.capacity()) * (sizeof(Shared<Material>) + sizeof(Material)) +
         u64(snapshot.textures.capacity()) * (sizeof(Shared<Texture>) + sizeof(Texture)) +
         u64(snapshot.volumes.capacity()) * (sizeof(Shared<Volume>) + sizeof(Volume));
}

}  // namespace heliograph::server
