// DecodeAsset in flight: gathers the files, has them decoded, stores the asset, tells the client.
#pragma once

#include <deque>
#include <mutex>
#include <optional>

#include "server/calls/rpc.h"
#include "server/calls/service.h"
#include "server/decode/decoder.h"
#include "server/quota/budget.h"

namespace heliograph::server {

/// Thread: any, one step at a time. Deletes itself when gRPC is done.
class DecodeCall final : public Writer<v1::DecodeAssetReply> {
 public:
  DecodeCall(Daemon& daemon, grpc::CallbackServerContext& context, Call call,
             const v1::DecodeAssetRequest& request)
      : daemon_(daemon), context_(context), call_(std::move(call)), request_(request) {}

  /// Starts on the pool; a full one ends the call.
  void post(WorkPool& pool) {
    if (auto posted = pool.post(call_.tenant()->id, [this] { start(); }); !posted)
      finish(std::unexpected(posted.error()));
  }

  void OnWriteDone(bool ok) override;
  void OnCancel() override { stop_.request_stop(); }
  void OnDone() override { delete this; }

 private:
  using Replies = std::deque<v1::DecodeAssetReply>;
  using Result = Expected<Replies>;

  void start();
  /// A file of the asset root is read by the decoder, for the disk may take its time.
  void gather_all();
  [[nodiscard]] Status gather();
  [[nodiscard]] Status gather_bundle();
  /// Charges and reads a file beneath the asset root.
  [[nodiscard]] Status gather_file(const std::string& path, const std::string& name);
  void submit();
  /// Charges the copy of all files that the decoder gets.
  [[nodiscard]] Status charge_copy();
  void on_decoded(Expected<Decoded> decoded);
  /// Reads companions that a server_path's model lacks; whether there were any.
  [[nodiscard]] Expected<bool> gather_missing(const std::vector<std::string>& missing);
  [[nodiscard]] Result store(const Decoded& decoded);
  void send_progress(double done);
  void finish(Result result);
  void finish_now();

  Daemon& daemon_;
  grpc::CallbackServerContext& context_;
  Call call_;
  const v1::DecodeAssetRequest& request_;
  std::stop_source stop_;
  Decoder* decoder_ = nullptr;    // whose threads may have this call while the daemon lets go of it
  v1::DecodeAssetRequest named_;  // what was decoded: its files, by hash, and its options
  std::vector<DecodeFile> files_;
  std::vector<Charge> read_;  // files of the asset root
  Charge copy_;               // while the decoder has it
  std::string hash_;
  std::mutex mutex_;
  bool is_writing_ = false;
  std::optional<Result> result_;  // replies that are still to be sent
  v1::DecodeAssetReply reply_;
};

}  // namespace heliograph::server
