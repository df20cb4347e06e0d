// Edits to a transaction, and the transaction on its way.
#include "heliograph/edit.h"

#include <algorithm>
#include <filesystem>
#include <utility>

#include "wire/apply_lane.h"
#include "wire/arrays.h"
#include "wire/assets.h"
#include "wire/companions.h"
#include "wire/convert.h"
#include "wire/studio.h"

namespace heliograph::client {
namespace {

using wire::Draft;
using wire::Node;

v1::Edit* add_edit(Draft& draft, Mode mode = Mode::kUpsert) {
  if (!draft.open)
    throw ClientError(Code::kFailedPrecondition,
                      "this transaction is over; open another with Scene::edit()");
  v1::Edit* edit = draft.transaction.add_edits();
  edit->set_mode(v1::Edit::Mode(int(mode)));
  return edit;
}

/// Calls the function that fills the last edit; takes the edit back if that fails.
template <class Fill>
void fill_edit(Draft& draft, const Fill& fill) {
  try {
    fill();
  } catch (...) {
    draft.transaction.mutable_edits()->RemoveLast();
    throw;
  }
}

std::shared_ptr<Node> made_node(const std::shared_ptr<Draft>& draft, Kind kind,
                                const std::string& name, std::int64_t edit) {
  auto node = wire::make_node(draft->scene, kind, name);
  node->draft = draft;
  node->is_made = true;
  node->edit = edit;
  return node;
}

/// An edit that puts an object called `name`; its handle.
template <class Made, class Fill>
Made put_object(const std::shared_ptr<Draft>& draft, const std::string& name, Mode mode,
                const Fill& fill) {
  v1::Edit* edit = add_edit(*draft, mode);
  if (!name.empty()) edit->mutable_target()->set_name(name);
  fill_edit(*draft, [&] { fill(edit); });
  const int index = draft->transaction.edits_size() - 1;
  auto node = made_node(draft, Made::kKind, name, index);
  draft->targets.push_back({index, false, {{Made::kKind, node}}});
  return Made(std::move(node));
}

/// Gives a new entity with a category a label of its own unless it has one.
void put_new_entity(const Components& components, Draft& draft, v1::Entity* out) {
  wire::put_entity(components, draft, out);
  if (out->has_label() && out->label().instance_case() == v1::Label::INSTANCE_NOT_SET &&
      components.fields().category)
    out->mutable_label()->set_auto_(true);
}

void check_transforms(const Array& transforms, std::size_t count, const std::string& field) {
  wire::check_rows(transforms, {4, 4}, field);
  if (transforms.shape()[0] == count) return;
  throw ClientError(Code::kInvalidArgument,
                    field + ": " + std::to_string(transforms.shape()[0]) + " matrices for " +
                        std::to_string(count) + " entities; give as many",
                    {field});
}

std::shared_ptr<wire::PendingEdit> hand_over(const std::shared_ptr<Draft>& draft) {
  if (!draft->open)
    throw ClientError(Code::kFailedPrecondition,
                      "this transaction was sent before; open another with Scene::edit()");
  wire::Session& session = *draft->scene->session;
  auto pending = std::make_shared<wire::PendingEdit>();
  pending->request.set_scene(draft->scene->id);
  if (draft->expected_revision) pending->request.set_expected_revision(*draft->expected_revision);
  pending->request.mutable_transaction()->Swap(&draft->transaction);
  pending->targets = std::move(draft->targets);
  draft->open = false;
  const auto limit = session.server().limits().find("message_bytes");
  const std::size_t bytes = pending->request.ByteSizeLong();
  if (limit != session.server().limits().end() && bytes > limit->second) {
    ErrorDetails details{"message"};
    details.limit = limit->first;
    details.needed = bytes;
    details.allowed = limit->second;
    throw ClientError(Code::kResourceExhausted,
                      "message: the transaction has " + std::to_string(bytes) +
                          " bytes, the daemon takes " + std::to_string(limit->second) +
                          "; split it into several, or raise the daemon's limit message_bytes",
                      std::move(details));
  }
  session.lane_of(draft->scene->id).submit(pending);
  return pending;
}

}  // namespace

Entity Edits::entity(const std::string& name, const Components& components, Mode mode) {
  return put_object<Entity>(draft_, name, mode, [&](v1::Edit* edit) {
    if (mode == Mode::kUpdate)
      wire::put_entity(components, *draft_, edit->mutable_entity());
    else
      put_new_entity(components, *draft_, edit->mutable_entity());
  });
}

Entity Edits::update(const Ref& target, const Components& components) {
  if (!target.handle()) return entity(target.name(), components, Mode::kUpdate);
  v1::Edit* edit = add_edit(*draft_, Mode::kUpdate);
  fill_edit(*draft_, [&] {
    wire::put_ref(target, draft_.get(), "name", edit->mutable_target());
    wire::put_entity(components, *draft_, edit->mutable_entity());
  });
  return Entity(target.handle().node());
}

Group Edits::instances(const std::string& name, const Array& transforms, const Components& shared) {
  wire::check_rows(transforms, {4, 4}, "transforms");
  v1::Edit* edit = add_edit(*draft_);
  edit->mutable_target()->set_name(name);
  fill_edit(*draft_, [&] {
    put_new_entity(shared, *draft_, edit->mutable_instances()->mutable_prototype());
    wire::put_edited(wire::as_f32(transforms, "transforms"), *draft_,
                     edit->mutable_instances()->mutable_matrices());
  });
  wire::IdTarget target{draft_->transaction.edits_size() - 1, true, {}};
  Group out;
  for (std::size_t i = 0; i < transforms.shape()[0]; ++i) {
    auto node = made_node(draft_, Kind::kEntity, name + "/" + std::to_string(i), wire::kByName);
    target.nodes.push_back({Kind::kEntity, node});
    out.emplace_back(std::move(node));
  }
  draft_->targets.push_back(std::move(target));
  return out;
}

void Edits::set_transforms(const Group& entities, const Array& transforms, bool teleport) {
  check_transforms(transforms, entities.size(), "transforms");
  const Array matrices = wire::as_f32(transforms, "transforms");
  const bool are_new = std::any_of(entities.begin(), entities.end(), [&](const Entity& entity) {
    return entity && entity.node()->id == 0 && entity.node()->draft.lock() == draft_;
  });
  if (are_new) {  // their ids are not known yet
    const auto poses = matrices.view<Mat4f>();
    for (std::size_t i = 0; i < entities.size(); ++i) {
      Mat4 matrix;
      for (std::size_t k = 0; k < 16; ++k) matrix(k / 4, k % 4) = poses[i](k / 4, k % 4);
      update(entities[i], Components().transform(matrix).teleport(teleport));
    }
    return;
  }
  std::vector<std::uint64_t> ids;
  ids.reserve(entities.size());
  for (const Entity& entity : entities) ids.push_back(entity.id());
  v1::Edit* edit = add_edit(*draft_);
  fill_edit(*draft_, [&] {
    v1::Poses* poses = edit->mutable_poses();
    wire::put_edited(Array(std::move(ids)), *draft_, poses->mutable_ids());
    wire::put_edited(matrices, *draft_, poses->mutable_matrices());
    poses->set_teleport(teleport);
  });
}

Mesh Edits::mesh(const std::string& name, const Geometry& geometry, Mode mode) {
  return put_object<Mesh>(draft_, name, mode, [&](v1::Edit* edit) {
    wire::put_mesh(geometry, *draft_, edit->mutable_mesh());
  });
}

Material Edits::material(const std::string& name, const Parameters& parameters, Mode mode) {
  return put_object<Material>(draft_, name, mode, [&](v1::Edit* edit) {
    wire::put_material(parameters, *draft_, edit->mutable_material());
  });
}

Texture Edits::texture(const std::string& name, const Image& image, Mode mode) {
  return put_object<Texture>(draft_, name, mode, [&](v1::Edit* edit) {
    wire::put_image(image, *draft_, edit->mutable_texture());
  });
}

Volume Edits::volume(const std::string& name, const Medium& medium, Mode mode) {
  return put_object<Volume>(draft_, name, mode, [&](v1::Edit* edit) {
    wire::put_volume(medium, *draft_, edit->mutable_volume());
  });
}

void Edits::dome(const Dome& dome) {
  v1::Dome message;
  wire::put_dome(dome, &message);
  if (!dome.image.path.empty() || !dome.image.texels.empty()) {
    const wire::DomeTexture texture = wire::dome_texture(dome.image, *draft_);
    const Texture made =
        put_object<Texture>(draft_, texture.name, Mode::kUpsert,
                            [&](v1::Edit* edit) { *edit->mutable_texture() = texture.message; });
    wire::put_ref(made, draft_.get(), "image", message.mutable_texture());
  }
  *add_edit(*draft_)->mutable_settings()->mutable_dome() = std::move(message);
}

Entity Edits::sample_studio(double floor) {
  Dome light;
  light.image.texels = wire::studio_dome();
  dome(light);
  const Mesh ground = mesh("floor/mesh", shapes::plane(floor));
  const Material paint = material("floor/material", Parameters().base_color(0.42).roughness(0.55));
  return entity("floor", Components().mesh(ground).material(paint).transform(Pose()).label(0));
}

Asset Edits::import_file(const std::string& path, const Placement& placement,
                         const ImportOptions& options) {
  auto asset = std::make_shared<wire::AssetState>();
  asset->scene = draft_->scene;
  asset->info = wire::decode_bundle(
      *draft_->scene->session, {path, options.server_path, options.up, options.units, "",
                                options.variant, options.surface, options.folders, options.strict});
  if (asset->info.has_texels())
    throw ClientError(Code::kInvalidArgument,
                      "path: " + path + " is a picture; use texture() or dome()", {"path"});
  const std::string& file = path.empty() ? options.server_path : path;
  const std::string stem = wire::readable(std::filesystem::path(file).stem().string());
  asset->name = options.name.empty() ? stem : options.name;
  wire::list_library(*asset, stem);
  Asset out(asset);
  for (int i = 0; i < options.count; ++i)
    instance(out, options.count == 1 ? asset->name : asset->name + "/" + std::to_string(i),
             placement);
  return out;
}

Entity Edits::instance(const Asset& asset, const std::string& name, const Placement& placement) {
  const Entity root = put_object<Entity>(draft_, name, Mode::kCreate, [&](v1::Edit* edit) {
    wire::put_placement(*asset.state(), placement, *draft_, edit->mutable_instantiate());
  });
  wire::IdTarget target{draft_->transaction.edits_size() - 1, true, {}};
  Group placed{root};
  const auto& names = asset.state()->info.entities();
  for (int i = 1; i < names.size(); ++i) {
    auto node = made_node(draft_, Kind::kEntity, names[i].empty() ? "" : name + "/" + names[i],
                          wire::kByName);
    target.nodes.push_back({Kind::kEntity, node});
    placed.emplace_back(std::move(node));
  }
  const wire::AssetState& state = *asset.state();
  for (const auto* nodes : {&state.meshes, &state.material_nodes, &state.textures})
    for (const auto& node : *nodes) target.nodes.push_back({node->kind, node});
  asset.state()->placed.push_back(std::move(placed));
  draft_->targets.push_back(std::move(target));
  return root;
}

const std::vector<std::string>& Edits::warnings() const { return draft_->warnings; }

void Edits::remove(const std::vector<Ref>& things, bool cascade) {
  for (const Ref& thing : things) {
    v1::Edit* edit = add_edit(*draft_);
    fill_edit(*draft_, [&] { wire::put_ref(thing, draft_.get(), "name", edit->mutable_target()); });
    edit->mutable_remove()->set_cascade(cascade);
  }
}

void Edits::sky(double elevation, double azimuth, const Air& air, const std::string& sun) {
  const Sky made = client::sky(elevation, azimuth, air);
  Dome whole;
  whole.image.texels = made.radiance;
  whole.color = Color(1);
  whole.intensity = 1;
  whole.rotation = Mat3::identity();
  dome(whole);
  Light light = Light::of(1, Light::Unit::kIrradiance);
  light.color = made.sun_irradiance;
  light.sun_angle = kSunAngle;
  entity(sun, Components().light(light).transform(look_at(made.sun_direction, {})));
}

void Edits::prune() { add_edit(*draft_)->mutable_prune(); }

void Edits::advance(double dt) { add_edit(*draft_)->mutable_advance()->set_dt(dt); }

void Edits::time(double seconds) { add_edit(*draft_)->mutable_settings()->set_time(seconds); }

void Edits::categories(const std::vector<std::string>& names) {
  v1::Settings* settings = add_edit(*draft_)->mutable_settings();
  for (const std::string& name : names) settings->add_categories(name);
}

std::uint64_t Transaction::commit() { return commit_later().wait(); }

Receipt Transaction::commit_later() { return Receipt(draft()->scene->session, hand_over(draft())); }

std::uint64_t Receipt::wait() {
  session_->lane_of(pending_->request.scene()).wait(*pending_);
  if (pending_->error) throw *pending_->error;
  return pending_->revision;
}

}  // namespace heliograph::client
