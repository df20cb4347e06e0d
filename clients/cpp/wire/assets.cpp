// DecodeAsset and the files that it asks for.
#include "wire/assets.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <optional>
#include <set>
#include <sstream>
#include <vector>

#include "wire/companions.h"
#include "wire/convert.h"
#include "wire/uploads.h"

namespace heliograph::client::wire {
namespace {

namespace fs = std::filesystem;
constexpr int kRounds = 64;  // of naming missing companions

[[noreturn]] void refuse(Code code, const std::string& message) {
  throw ClientError(code, "path: " + message, {"path"});
}

/// Path of a companion file; nothing: it is missing, or may not be read.
std::optional<fs::path> companion(const Source& source, const std::string& name) {
  if (source.path.empty()) return std::nullopt;
  return find_companion(fs::absolute(source.path).parent_path(), name, source.folders);
}

v1::DecodeAssetRequest::Axis axis_of(const std::string& name) {
  const std::vector<std::string> names{"", "x", "y", "z"};
  const auto found = std::find(names.begin(), names.end(), name);
  if (found == names.end())
    throw ClientError(Code::kInvalidArgument, "up: \"" + name + "\" is not one of x, y, z", {"up"});
  return v1::DecodeAssetRequest::Axis(found - names.begin());
}

void add_file(Session& session, const std::string& name, const fs::path& path,
              v1::DecodeAssetRequest* request) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream content;
  content << file.rdbuf();
  if (!file) refuse(Code::kNotFound, "cannot read " + path.string() + "; correct the path");
  v1::BundleFile* to = request->add_files();
  to->set_path(name);
  to->set_sha256(session.uploads().blob(content.str()));
}

v1::DecodeAssetReply ask(Session& session, const v1::DecodeAssetRequest& request) {
  grpc::ClientContext context;
  session.prepare(context);
  const auto reader = session.stub().DecodeAsset(&context, request);
  v1::DecodeAssetReply out;
  for (v1::DecodeAssetReply reply; reader->Read(&reply);) {
    out.mutable_missing()->MergeFrom(reply.missing());
    if (reply.has_asset()) out.mutable_asset()->MergeFrom(reply.asset());  // it comes in pieces
  }
  session.check(reader->Finish());
  return out;
}

}  // namespace

v1::AssetInfo decode_bundle(Session& session, const Source& source) {
  if (source.path.empty() == source.server_path.empty())
    refuse(Code::kInvalidArgument, "give path or server_path, one of them");
  v1::DecodeAssetRequest request;
  request.set_server_path(source.server_path);
  request.set_up(axis_of(source.up));
  request.set_units(source.units);
  request.set_layer(source.layer);
  request.set_variant(source.variant);
  request.set_surface(source.surface);
  const fs::path model(source.path);
  if (!source.path.empty()) {
    std::error_code error;
    if (!fs::is_regular_file(model, error))
      refuse(Code::kNotFound, "no file " + source.path + "; correct the path");
    add_file(session, readable(model.filename().string()), model, &request);
  }
  std::set<std::string> sent;
  for (int round = 0; round < kRounds; ++round) {
    const v1::DecodeAssetReply reply = ask(session, request);
    if (reply.has_asset()) return reply.asset();
    bool has_new = false;
    for (const std::string& name : reply.missing()) {
      if (!sent.insert(name).second) continue;
      has_new = true;
      const auto found = companion(source, name);
      if (found)
        add_file(session, name, *found, &request);
      else if (source.strict)
        refuse(Code::kNotFound, "the model refers to \"" + name +
                                    "\", which is neither beneath "
                                    "its folder nor beneath `folders`; copy it there");
      else
        request.add_files()->set_path(name);  // without a hash: nobody has it
    }
    if (!has_new) break;
  }
  refuse(Code::kNotFound, source.path + ": the daemon still misses files; export the model again");
}

void list_library(AssetState& asset, const std::string& stem) {
  const auto list = [&](Kind kind, const auto& names, auto& nodes) {
    for (const std::string& name : names)
      nodes.push_back(make_node(asset.scene, kind, name.empty() ? "" : stem + "/" + name));
  };
  list(Kind::kMesh, asset.info.meshes(), asset.meshes);
  list(Kind::kMaterial, asset.info.materials(), asset.material_nodes);
  list(Kind::kTexture, asset.info.textures(), asset.textures);
  asset.materials.assign(asset.info.materials().begin(), asset.info.materials().end());
  asset.animations.assign(asset.info.animations().begin(), asset.info.animations().end());
  asset.warnings.assign(asset.info.warnings().begin(), asset.info.warnings().end());
}

void put_placement(const AssetState& asset, const Placement& placement, Draft& draft,
                   v1::Instantiate* out) {
  out->set_asset(asset.info.sha256());
  if (placement.transform) put_pose(*placement.transform, out->mutable_pose());
  if (placement.parent) put_ref(*placement.parent, &draft, "parent", out->mutable_parent());
  if (placement.label || placement.category || placement.group) {
    v1::Label* label = out->mutable_label();
    if (placement.label) label->set_value(*placement.label);
    if (!placement.label && placement.category) label->set_auto_(true);
    if (placement.category) label->set_category(*placement.category);
    if (placement.group) label->set_group(*placement.group);
  }
  for (const auto& [name, material] : placement.materials) {
    known(asset.materials, name, "materials");
    put_ref(material, &draft, "materials", &(*out->mutable_materials())[name]);
  }
  if (placement.animation)
    out->set_animation(std::uint32_t(known(asset.animations, *placement.animation, "animation")));
}

std::size_t known(const std::vector<std::string>& names, const std::string& name,
                  const std::string& field) {
  const auto found = std::find(names.begin(), names.end(), name);
  if (found != names.end()) return std::size_t(found - names.begin());
  ErrorDetails details{field};
  details.nearest = names;
  std::string have;
  for (const std::string& other : names) have += (have.empty() ? "" : ", ") + other;
  throw ClientError(
      Code::kNotFound,
      field + ": the file has no \"" + name + "\"; it has " + (have.empty() ? "none" : have),
      std::move(details));
}

}  // namespace heliograph::client::wire
