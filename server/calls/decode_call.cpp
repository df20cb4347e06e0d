// See decode_call.h.
#include "server/calls/decode_call.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <set>

#include "server/convert/asset.h"
#include "server/os/hash.h"

namespace heliograph::server {
namespace {

/// Returns the folder of a path, with its slash.
std::string folder_of(const std::string& path) { return path.substr(0, path.rfind('/') + 1); }

/// The decoder's names of the axes, by enum value.
constexpr std::array kAxes{"", "x", "y", "z"};
static_assert(kAxes.size() == v1::DecodeAssetRequest::Axis_ARRAYSIZE);

std::deque<v1::DecodeAssetReply> replies_of(const v1::AssetInfo& info) {
  std::deque<v1::DecodeAssetReply> replies;
  for (v1::AssetInfo& piece : cut(info)) {
    v1::DecodeAssetReply& reply = replies.emplace_back();
    reply.set_done(1);
    *reply.mutable_asset() = std::move(piece);
  }
  return replies;
}

}  // namespace

void DecodeCall::start() {
  if (!daemon_.decoder)
    return finish(fail(Code::kUnavailable, "",
                       "the decoder could not be started: " + daemon_.decoder.error().message));
  decoder_ = daemon_.decoder->get();
  if (request_.server_path().empty()) return gather_all();
  decoder_->read(
      call_.session()->tenant()->id, [this] { gather_all(); },
      [this](const Status& refused) { finish(std::unexpected(refused.error())); });
}

void DecodeCall::gather_all() {
  if (stop_.stop_requested()) return finish(fail(Code::kCancelled, "", "the decode was cancelled"));
  if (auto gathered = gather(); !gathered) return finish(std::unexpected(gathered.error()));
  submit();
}

Status DecodeCall::gather() {
  HELIO_TRY(call_.session()->tenant()->ledger.bytes->admit(Work::kUploads));
  named_ = request_;
  named_.clear_server_path();
  if (request_.server_path().empty()) return gather_bundle();
  if (std::ranges::any_of(request_.files(), [](const auto& f) { return !f.sha256().empty(); }))
    return fail(Code::kInvalidArgument, "files", "goes without server_path; send one of them");
  const std::string& path = request_.server_path();
  HELIO_TRY(gather_file(path, path.substr(folder_of(path).size())));
  for (const v1::BundleFile& file : request_.files()) files_.push_back({file.path(), nullptr});
  return {};
}

Status DecodeCall::gather_file(const std::string& path, const std::string& name) {
  const auto file = daemon_.asset_root.find(path, daemon_.config.limits.blob_bytes);
  if (!file) return std::unexpected(file.error());
  auto charge = Charge::take(call_.session()->tenant()->ledger.bytes, file->size);
  if (!charge) return std::unexpected(std::move(charge).error().at("server_path"));
  read_.push_back(std::move(*charge));
  auto bytes = file->read();
  if (!bytes) return std::unexpected(bytes.error());
  files_.push_back({name, std::move(*bytes)});
  return {};
}

Status DecodeCall::gather_bundle() {
  if (request_.files_size() == 0)
    return fail(Code::kInvalidArgument, "files", "is empty; name the model and upload its bytes");
  std::set<std::string_view> paths;
  for (int i = 0; i < request_.files_size(); ++i) {
    const v1::BundleFile& file = request_.files(i);
    if (!paths.insert(file.path()).second)
      return fail(Code::kInvalidArgument, fmt::format("files[{}].path", i),
                  fmt::format("'{}' is in the bundle twice; send each path once", file.path()));
    if (i > 0 && file.sha256().empty()) {
      files_.push_back({file.path(), nullptr});
      continue;
    }
    auto bytes = call_.session()->arrays().blob(file.sha256());
    if (!bytes)
      return std::unexpected(std::move(bytes).error().at(fmt::format("files[{}].sha256", i)));
    files_.push_back({file.path(), std::move(*bytes)});
  }
  return {};
}

void DecodeCall::submit() {
  if (!request_.server_path().empty()) {
    named_.clear_files();
    for (const DecodeFile& file : files_) {
      v1::BundleFile* named = named_.add_files();
      named->set_path(file.path);
      if (file.bytes) named->set_sha256(sha256(file.bytes->bytes()));
    }
  }
  hash_ = asset_hash(named_);
  if (const auto known = call_.session()->arrays().find_asset(hash_)) {
    return finish(replies_of(known->info));
  }
  if (auto charged = charge_copy(); !charged)
    return finish(std::unexpected(
        std::move(charged).error().at(request_.server_path().empty() ? "files" : "server_path")));
  send_progress(0);
  DecodeJob job{.files = files_,
                .format = request_.format(),
                .up = kAxes[std::size_t(request_.up())],
                .units = request_.units(),
                .layer = request_.layer(),
                .variant = request_.variant(),
                .surface = request_.surface(),
                .hash = hash_,
                .tenant = call_.session()->tenant()->id,
                .pay = [tenant = call_.session()->tenant()](u64 bytes) {
                  return Charge::hold(tenant->ledger.bytes, bytes);
                }};
  decoder_->decode(
      std::move(job), [this](Expected<Decoded> decoded) { on_decoded(std::move(decoded)); },
      stop_.get_token());
}

Status DecodeCall::charge_copy() {
  u64 bytes = 0;
  for (const DecodeFile& file : files_) bytes += file.bytes ? file.bytes->bytes().size() : 0;
  if (const u64 most = daemon_.config.limits.decode_bytes; bytes > most) {
    Error error{.code = Code::kResourceExhausted,
                .message = fmt::format("have {} bytes in all, {} are allowed: send smaller files, "
                                       "or several bundles (limit decode_bytes)",
                                       bytes, most),
                .where = ""};
    error.needed = bytes;
    error.available = most;
    error.limit = "decode_bytes";
    return std::unexpected(std::move(error));
  }
  auto charge = Charge::take(call_.session()->tenant()->ledger.bytes, bytes);
  if (!charge) return std::unexpected(std::move(charge).error());
  copy_ = std::move(*charge);
  return {};
}

void DecodeCall::on_decoded(Expected<Decoded> decoded) {
  copy_ = Charge();
  daemon_.metrics.decode(decoded ? Status() : std::unexpected(decoded.error()));
  if (!decoded) return finish(std::unexpected(decoded.error()));
  if (request_.server_path().empty() || decoded->missing.empty()) return finish(store(*decoded));
  const auto more = gather_missing(decoded->missing);
  if (!more) return finish(std::unexpected(more.error()));
  if (*more) return submit();
  finish(store(*decoded));
}

Expected<bool> DecodeCall::gather_missing(const std::vector<std::string>& missing) {
  const std::string folder = folder_of(request_.server_path());
  bool is_any = false;
  for (const std::string& path : missing) {
    if (std::ranges::any_of(files_, [&](const auto& f) { return f.path == path; })) continue;
    const Status gathered = gather_file(folder + path, path);
    if (!gathered && gathered.error().code != Code::kNotFound)
      return std::unexpected(gathered.error());
    is_any |= gathered.has_value();
  }
  return is_any;
}

DecodeCall::Result DecodeCall::store(const Decoded& decoded) {
  if (!decoded.missing.empty()) {
    v1::DecodeAssetReply reply;
    reply.set_done(1);
    reply.mutable_missing()->Add(decoded.missing.begin(), decoded.missing.end());
    return Replies{std::move(reply)};
  }
  SessionArrays& arrays = call_.session()->arrays();
  for (int i = 0; request_.server_path().empty() && i < request_.files_size(); ++i)
    if (const BufferPtr& bytes = files_[std::size_t(i)].bytes)
      arrays.used(request_.files(i).sha256(), bytes);
  auto stored = std::make_shared<StoredAsset>();
  if (decoded.image) {
    stored->texels = decoded.image->texels;
    stored->info = to_info(*decoded.image, decoded.image_srgb, arrays.hold(decoded.image->texels));
  } else {
    stored->asset = decoded.asset;
    stored->info = to_info(*decoded.asset, decoded.bounds_min, decoded.bounds_max);
  }
  stored->bytes = decoded.bytes;
  stored->info.set_sha256(hash_);
  for (const std::string& warning : decoded.warnings) stored->info.add_warnings(warning);
  return replies_of(arrays.hold(std::move(stored))->info);
}

void DecodeCall::send_progress(double done) {
  {
    const std::lock_guard lock(mutex_);
    if (is_writing_) return;
    is_writing_ = true;
    reply_.set_done(done);
  }
  StartWrite(&reply_);
}

void DecodeCall::OnWriteDone(bool) {
  bool is_over;
  {
    const std::lock_guard lock(mutex_);
    is_writing_ = false;
    is_over = result_.has_value();
  }
  if (is_over) finish_now();
}

void DecodeCall::finish(Result result) {
  bool is_writing;
  {
    const std::lock_guard lock(mutex_);
    result_ = std::move(result);
    is_writing = is_writing_;
  }
  if (!is_writing) finish_now();
}

void DecodeCall::finish_now() {
  if (!*result_) return Finish(to_status(result_->error(), context_));
  Replies& left = **result_;
  reply_ = std::move(left.front());
  left.pop_front();
  if (left.empty()) return StartWriteAndFinish(&reply_, grpc::WriteOptions(), grpc::Status::OK);
  {
    const std::lock_guard lock(mutex_);
    is_writing_ = true;
  }
  StartWrite(&reply_);
}

}  // namespace heliograph::server
