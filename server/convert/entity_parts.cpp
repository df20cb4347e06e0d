// Parts of an entity itself: label, skin, portal.
#include <fmt/format.h>

#include "server/convert/fields.h"
#include "server/convert/nouns.h"

namespace heliograph::server {
namespace {

constexpr u32 kLargestLabel = 0xfffffffeu;
constexpr Range kPortalSize{1e-6, 1e6};

}  // namespace

Expected<LabelPatch> to_label(const v1::Label& message) {
  LabelPatch patch;
  if (message.has_value()) {
    patch.kind = LabelPatch::Kind::kValue;
    HELIO_TAKE(patch.value, in_range(message.value(), {0, double(kLargestLabel)}), "value");
  } else if (message.has_auto_()) {
    if (!message.auto_())
      return fail(
          Code::kInvalidArgument, "auto",
          "is false; set it to true, give value 0 to opt out, or leave both out to inherit");
    patch.kind = LabelPatch::Kind::kAuto;
  }
  patch.group = message.group();
  if (message.has_category()) patch.category = message.category();
  patch.part = message.part();
  return patch;
}

v1::Label to_proto(const LabelPatch& patch) {
  v1::Label message;
  if (patch.kind == LabelPatch::Kind::kValue) message.set_value(patch.value);
  if (patch.kind == LabelPatch::Kind::kAuto) message.set_auto_(true);
  message.set_group(patch.group);
  if (patch.category) message.set_category(*patch.category);
  message.set_part(patch.part);
  return message;
}

Expected<Portal> to_portal(const v1::Portal& message) {
  Portal portal;
  if (message.has_width())
    HELIO_TAKE(portal.width, in_range(message.width(), kPortalSize), "width");
  if (message.has_height())
    HELIO_TAKE(portal.height, in_range(message.height(), kPortalSize), "height");
  return portal;
}

v1::Portal to_proto(const Portal& portal) {
  v1::Portal message;
  message.set_width(portal.width);
  message.set_height(portal.height);
  return message;
}

Expected<SkinPatch> to_skin(const v1::Skin& message, ArraySource& source) {
  SkinPatch patch;
  if (message.joints_size() < 1 || message.joints_size() > 65536)
    return fail(Code::kInvalidArgument, "joints",
                fmt::format("has {} entities; give 1 to 65536", message.joints_size()));
  HELIO_TAKE(patch.joints, to_refs(message.joints()), "joints");
  if (!message.has_inverse_binds()) {
    patch.inverse_binds.assign(patch.joints.size(), mat4x3(1));
    return patch;
  }
  const Dims dims{{"J", patch.joints.size()}, kFour, kFour};
  HELIO_TAKE(patch.inverse_binds, read_affine(message.inverse_binds(), source, dims),
             "inverse_binds");
  return patch;
}

v1::Skin to_proto(const SkinPatch& patch, const ArraySink& sink) {
  v1::Skin message;
  for (const Ref& joint : patch.joints) *message.add_joints() = to_proto(joint);
  *message.mutable_inverse_binds() = to_array(patch.inverse_binds, false, sink);
  return message;
}

}  // namespace heliograph::server
