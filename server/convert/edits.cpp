// Transactions: each edit's mode, target and action. Called by the service, ImportScene and the
// decoder.
#include <fmt/format.h>

#include <map>

#include "server/convert/array.h"
#include "server/convert/fields.h"
#include "server/convert/nouns.h"

namespace heliograph::server {
namespace {

Expected<Instantiate> to_instantiate(const v1::Instantiate& message, ArraySource& source) {
  Instantiate action;
  HELIO_CHECK(check_hash(message.asset()), "asset");
  HELIO_TAKE(action.asset, source.asset(message.asset()), "asset");
  if (message.has_parent()) HELIO_TAKE(action.parent, to_ref(message.parent()), "parent");
  if (message.has_pose()) HELIO_TAKE(action.pose, to_pose(message.pose(), source), "pose");
  if (message.has_label()) HELIO_TAKE(action.label, to_label(message.label()), "label");
  const std::map<std::string, v1::Ref> sorted(message.materials().begin(),
                                              message.materials().end());
  for (const auto& [name, ref] : sorted)
    HELIO_TAKE(action.materials.emplace_back(name, Ref{}).second, to_ref(ref),
               fmt::format("materials[\"{}\"]", name));
  if (!message.has_animation()) return action;
  action.animation = message.animation();
  if (const auto clips = action.asset->animations.size(); *action.animation >= clips)
    return fail(Code::kInvalidArgument, "animation",
                fmt::format("is {}; the asset has {} animations, counted from 0; absent binds none",
                            message.animation(), clips));
  return action;
}

v1::Instantiate instantiate_to_proto(const Instantiate& action, const ArraySink& sink) {
  v1::Instantiate message;
  message.set_asset(action.asset->hash);
  if (action.parent) *message.mutable_parent() = to_proto(*action.parent);
  if (action.pose) *message.mutable_pose() = to_proto(*action.pose, sink);
  if (action.label) *message.mutable_label() = to_proto(*action.label);
  for (const auto& [name, ref] : action.materials)
    (*message.mutable_materials())[name] = to_proto(ref);
  if (action.animation) message.set_animation(*action.animation);
  return message;
}

Expected<Instances> to_instances(const v1::Instances& message, ArraySource& source) {
  Instances action;
  if (message.prototype().has_pose())
    return fail(Code::kInvalidArgument, "prototype.pose",
                "has no place here; the poses are in matrices");
  HELIO_TAKE(action.prototype, to_entity(message.prototype(), source), "prototype");
  HELIO_TAKE(action.matrices, read_poses(message.matrices(), source, {{"N", {}}, kFour, kFour}),
             "matrices");
  return action;
}

Expected<Poses> to_poses(const v1::Poses& message, ArraySource& source) {
  Poses action{.teleport = message.teleport()};
  HELIO_TAKE(action.ids, read_integers<Id>(message.ids(), source, {{"N", {}}}, v1::D_TYPE_U64),
             "ids");
  const Dims dims{{"N", action.ids.size()}, kFour, kFour};
  HELIO_TAKE(action.matrices, read_many_poses(message.matrices(), source, dims), "matrices");
  return action;
}

v1::Poses poses_to_proto(const Poses& action, const ArraySink& sink) {
  v1::Poses message;
  const u64 count = action.ids.size();
  *message.mutable_ids() =
      to_array(action.ids.buffer(), v1::D_TYPE_U64, std::span(&count, 1), sink);
  *message.mutable_matrices() = to_array(action.matrices.span(), false, sink);
  message.set_teleport(action.teleport);
  return message;
}

Expected<PutSettings> to_settings(const v1::Settings& message, ArraySource& source) {
  PutSettings patch;
  if (message.has_time()) HELIO_TAKE(patch.time, in_range(message.time(), {-1e9, 1e9}), "time");
  if (message.has_dome()) HELIO_TAKE(patch.dome, to_dome(message.dome(), source), "dome");
  for (const std::string& category : message.categories()) {
    if (category.empty())
      return fail(Code::kInvalidArgument, fmt::format("categories[{}]", patch.categories.size()),
                  "is empty; a class has a name");
    patch.categories.push_back(category);
  }
  return patch;
}

Expected<Advance> to_advance(const v1::Advance& message) {
  if (std::isfinite(message.dt()) && message.dt() > 0 && message.dt() <= 1e9)
    return Advance{message.dt()};
  return fail(
      Code::kInvalidArgument, "dt",
      fmt::format("is {} s; time goes forward: give more than 0 and at most 1e9", message.dt()));
}

/// Reads the action of one case; the field's name prefixes its errors.
Expected<Action> to_action(const v1::Edit& edit, ArraySource& source) {
  Action action;
  switch (edit.action_case()) {
    case v1::Edit::kEntity:
      HELIO_TAKE(action, to_entity(edit.entity(), source), "entity");
      break;
    case v1::Edit::kMesh:
      HELIO_TAKE(action, to_mesh(edit.mesh(), source), "mesh");
      break;
    case v1::Edit::kMaterial:
      HELIO_TAKE(action, to_material(edit.material(), source), "material");
      break;
    case v1::Edit::kTexture:
      HELIO_TAKE(action, to_texture(edit.texture(), source), "texture");
      break;
    case v1::Edit::kVolume:
      HELIO_TAKE(action, to_volume(edit.volume(), source), "volume");
      break;
    case v1::Edit::kRemove:
      action = Remove{edit.remove().cascade()};
      break;
    case v1::Edit::kInstantiate:
      HELIO_TAKE(action, to_instantiate(edit.instantiate(), source), "instantiate");
      break;
    case v1::Edit::kInstances:
      HELIO_TAKE(action, to_instances(edit.instances(), source), "instances");
      break;
    case v1::Edit::kPoses:
      HELIO_TAKE(action, to_poses(edit.poses(), source), "poses");
      break;
    case v1::Edit::kSettings:
      HELIO_TAKE(action, to_settings(edit.settings(), source), "settings");
      break;
    case v1::Edit::kAdvance:
      HELIO_TAKE(action, to_advance(edit.advance()), "advance");
      break;
    case v1::Edit::kPrune:
      action = Prune{};
      break;
    case v1::Edit::ACTION_NOT_SET:
      return fail(Code::kInvalidArgument, "", "does nothing; set one of its actions");
  }
  return action;
}

/// Checks the target: edits of the scene have none, a removal must have one, others may.
Status check_target(const Edit& edit, bool given) {
  const bool named = !std::holds_alternative<std::monostate>(edit.target);
  const bool of_scene = std::holds_alternative<PutSettings>(edit.action) ||
                        std::holds_alternative<Advance>(edit.action) ||
                        std::holds_alternative<Prune>(edit.action) ||
                        std::holds_alternative<Poses>(edit.action);
  if (given && of_scene)
    return fail(Code::kInvalidArgument, "target", "has no place here; leave it out");
  if (given && !named)
    return fail(Code::kInvalidArgument, "target.id",
                "is 0, which is nothing; leave the target out for a new object without a name");
  if (!named && std::holds_alternative<Remove>(edit.action))
    return fail(Code::kInvalidArgument, "target", "is missing; say what to remove");
  return {};
}

constexpr std::array kModes{Mode::kUpsert, Mode::kCreate, Mode::kUpdate, Mode::kUpsert};
static_assert(kModes.size() == v1::Edit::Mode_ARRAYSIZE);

Expected<Edit> to_edit(const v1::Edit& message, ArraySource& source) {
  Edit edit{.mode = from_enum(kModes, message.mode())};
  if (message.has_target()) HELIO_TAKE(edit.target, to_ref(message.target()), "target");
  auto action = to_action(message, source);
  if (!action) return std::unexpected(std::move(action).error());
  edit.action = std::move(*action);
  HELIO_TRY(check_target(edit, message.has_target()));
  return edit;
}

/// Writes an action into the case of its type.
struct WriteAction {
  v1::Edit& edit;
  const ArraySink& sink;

  void operator()(const PutEntity& p) const { *edit.mutable_entity() = to_proto(p, sink); }
  void operator()(const PutMesh& p) const { *edit.mutable_mesh() = to_proto(p, sink); }
  void operator()(const PutMaterial& p) const { *edit.mutable_material() = to_proto(p, sink); }
  void operator()(const PutTexture& p) const { *edit.mutable_texture() = to_proto(p, sink); }
  void operator()(const PutVolume& p) const { *edit.mutable_volume() = to_proto(p, sink); }
  void operator()(const Remove& r) const { edit.mutable_remove()->set_cascade(r.cascade); }
  void operator()(const Instantiate& i) const {
    *edit.mutable_instantiate() = instantiate_to_proto(i, sink);
  }
  void operator()(const Instances& i) const {
    *edit.mutable_instances()->mutable_prototype() = to_proto(i.prototype, sink);
    *edit.mutable_instances()->mutable_matrices() = to_array(i.matrices, false, sink);
  }
  void operator()(const Poses& p) const { *edit.mutable_poses() = poses_to_proto(p, sink); }
  void operator()(const PutSettings& s) const {
    v1::Settings* message = edit.mutable_settings();
    if (s.time) message->set_time(*s.time);
    if (s.dome) *message->mutable_dome() = to_proto(*s.dome, sink);
    for (const std::string& category : s.categories) message->add_categories(category);
  }
  void operator()(const Advance& a) const { edit.mutable_advance()->set_dt(a.dt); }
  void operator()(const Prune&) const { edit.mutable_prune(); }
};

/// Reads each edit, then calls `after` with its index.
template <class After>
Expected<Transaction> read_edits(const v1::Transaction& message, ArraySource& source,
                                 const After& after) {
  HELIO_TRY(check_known(message));
  Transaction transaction;
  transaction.edits.reserve(std::size_t(message.edits_size()));
  for (int i = 0; i < message.edits_size(); ++i) {
    auto edit = to_edit(message.edits(i), source);
    if (!edit) return std::unexpected(std::move(edit).error().at(indexed("edits", u64(i))));
    transaction.edits.push_back(std::move(*edit));
    after(i);
  }
  return transaction;
}

}  // namespace

Expected<Transaction> to_transaction(const v1::Transaction& message, ArraySource& source) {
  return read_edits(message, source, [](int) {});
}

Expected<Transaction> to_transaction(v1::Transaction&& message, ArraySource& source) {
  return read_edits(message, source, [&](int i) { message.mutable_edits(i)->Clear(); });
}

v1::Edit to_proto(const Edit& edit, const ArraySink& sink) {
  v1::Edit message;
  message.set_mode(v1::Edit::Mode(edit.mode));
  if (!std::holds_alternative<std::monostate>(edit.target))
    *message.mutable_target() = to_proto(edit.target);
  std::visit(WriteAction{message, sink}, edit.action);
  return message;
}

v1::Transaction to_proto(const Transaction& transaction, const ArraySink& sink) {
  v1::Transaction message;
  for (const Edit& edit : transaction.edits) *message.add_edits() = to_proto(edit, sink);
  return message;
}

}  // namespace heliograph::server
